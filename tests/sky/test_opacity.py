"""Opacities from files and values, and laws of temperature."""

import numpy as np
import pytest
from astropy import units as u
from astropy.table import QTable

from discsim.output.fields.base import PlotError
from discsim.sky.opacity import opacity_of
from discsim.sky.temperature import law_of


def kappa(wavelength, size):
    """A power law, which interpolation in logarithms has exactly: cm2/g for mm and cm."""
    return 3.0 * wavelength**-1.3 * size**-0.4


def write_table(path, sizes=(0.001, 0.02, 0.3), wavelengths=(2.7, 0.4, 1.1), factor=1.0):
    """An ECSV table in other units than the code's, rows in no order."""
    rows = [(w, s) for s in sizes for w in wavelengths]
    w, s = np.array(rows).T
    table = QTable({"wavelength": (1e3 * w) * u.um, "size": (10 * s) * u.mm})
    table["absorption"] = factor * kappa(w, s) * u.cm**2 / u.g
    table.write(path, format="ascii.ecsv")
    return path


def test_power_law_of_a_table_is_found_between_its_sizes_and_wavelengths(tmp_path):
    found = opacity_of(write_table(tmp_path / "dust.ecsv"))
    size = np.array([0.0021, 0.15, 0.3])
    given = found.absorption(0.87 * u.mm, np.zeros(3, int), size)
    assert given == pytest.approx(kappa(0.87, size), rel=1e-12)
    assert found.text == "table dust.ecsv"


def test_arrays_of_dsharp_opac_are_read(tmp_path):
    """npz with sizes a and wavelengths lam in cm, both falling here."""
    a, lam = np.array([0.5, 0.01]), np.array([0.3, 0.08, 0.02])
    np.savez(tmp_path / "dsharp.npz", a=a, lam=lam, k_abs=kappa(10 * lam[None, :], a[:, None]), k_sca=np.ones((2, 3)))
    found = opacity_of(str(tmp_path / "dsharp.npz")).absorption(1.3 * u.mm, np.zeros(1, int), np.array([0.07]))
    assert found == pytest.approx(kappa(1.3, 0.07), rel=1e-12)


def test_a_table_without_sizes_holds_for_all_grains(tmp_path):
    QTable({"wavelength": [3.0, 0.5] * u.mm, "absorption": [0.2, 0.9] * u.m**2 / u.kg}).write(tmp_path / "o.ecsv")
    found = opacity_of(tmp_path / "o.ecsv").absorption(3.0 * u.mm, np.zeros(2, int), None)
    assert found == pytest.approx([2.0, 2.0], rel=1e-12)


def test_default_is_beckwith_and_values_belong_to_populations():
    species = np.array([1, 0, 1])
    assert opacity_of(None).absorption(1.0 * u.mm, species, None) == pytest.approx(10 * 0.299792458)
    assert list(opacity_of("2 cm2/g, 0.03 m2/kg").absorption(1.0 * u.mm, species, None)) == [0.3, 2.0, 0.3]
    assert list(opacity_of([4 * u.cm**2 / u.g]).absorption(1.0 * u.mm, species, None)) == [4.0] * 3


def damaged(tmp_path, text):
    (tmp_path / "x.ecsv").write_text(text)
    return str(tmp_path / "x.ecsv")


HEAD = "# %ECSV 1.0\n# ---\n# datatype:\n"
WAVELENGTH = "# - {name: wavelength, unit: mm, datatype: float64}\n"
ABSORPTION = "# - {name: absorption, unit: cm2 / g, datatype: float64}\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "not an ECSV table"),
        ("\x00\xff" * 40, "not an ECSV table"),
        (HEAD + WAVELENGTH + "wavelength\n1.0\n", "no column absorption"),
        (
            HEAD + WAVELENGTH + ABSORPTION.replace("cm2 / g", "cm") + "wavelength absorption\n1.0 2.0\n",
            "no unit like cm2/g",
        ),
        (HEAD + WAVELENGTH + ABSORPTION + "wavelength absorption\n1.0 2.0\n1.0 3.0\n", "a wavelength occurs twice"),
        (HEAD + WAVELENGTH + ABSORPTION + "wavelength absorption\n1.0 -2.0\n2.0 3.0\n", "not positive and finite"),
        (HEAD + WAVELENGTH + ABSORPTION + "wavelength absorption\n1.0 nan\n2.0 3.0\n", "not positive and finite"),
        (HEAD + WAVELENGTH + ABSORPTION + "wavelength absorption\n", "not positive and finite"),
    ],
)
def test_a_damaged_table_is_one_message(tmp_path, text, message):
    with pytest.raises(PlotError) as error:
        opacity_of(damaged(tmp_path, text))
    assert message in str(error.value) and "\n" not in str(error.value) and "x.ecsv" in str(error.value)


def test_grains_and_wavelengths_outside_of_a_table_are_refused(tmp_path):
    found = opacity_of(write_table(tmp_path / "dust.ecsv"))
    with pytest.raises(PlotError, match=r"wavelengths from 0.4 to 2.7 mm, but 3 to 3 mm are needed"):
        found.absorption(3.0 * u.mm, np.zeros(1, int), np.array([0.01]))
    with pytest.raises(PlotError, match=r"grain sizes from 0.001 to 0.3 cm, but 0.01 to 2 cm are needed"):
        found.absorption(1.0 * u.mm, np.zeros(2, int), np.array([0.01, 2.0]))
    with pytest.raises(PlotError, match="the run has no grain sizes"):
        found.absorption(1.0 * u.mm, np.zeros(2, int), None)


def test_a_pair_that_is_missing_or_twice_is_refused(tmp_path):
    path = write_table(tmp_path / "dust.ecsv")
    lines = path.read_text().splitlines()
    path.write_text("\n".join(lines[:-1]))
    with pytest.raises(
        PlotError, match="8 rows for 3 wavelengths and 3 sizes; give each pair of wavelength and size once"
    ):
        opacity_of(path)
    path.write_text("\n".join([*lines[:-1], lines[-2]]))
    with pytest.raises(
        PlotError, match="9 rows for 3 wavelengths and 3 sizes; give each pair of wavelength and size once"
    ):
        opacity_of(path)


@pytest.mark.parametrize(
    "broken", [b"", b"PK\x03\x04 no zip", None], ids=["empty", "no archive", "an array of objects"]
)
def test_a_damaged_npz_is_one_message(tmp_path, broken):
    path = tmp_path / "x.npz"
    if broken is None:
        np.savez(path, a=np.array([{}], dtype=object), lam=np.ones(1), k_abs=np.ones((1, 1)))
    else:
        path.write_bytes(broken)
    with pytest.raises(PlotError) as error:
        opacity_of(path)
    assert "expected arrays lam, a and k_abs of dsharp_opac" in str(error.value) and "\n" not in str(error.value)


def test_a_file_that_is_not_there_is_one_message(tmp_path):
    with pytest.raises(PlotError, match=r"none\.ecsv: cannot be read: No such file"):
        opacity_of(tmp_path / "none.ecsv")


def test_passive_disc_of_chiang_and_goldreich():
    """T^4 = phi L / (8 pi sigma r^2) at 7 au for 2.3 Lsun and phi = 0.03."""
    from astropy import constants

    wanted = (0.03 * 2.3 * u.Lsun / (8 * np.pi * constants.sigma_sb * (7 * u.au) ** 2)) ** 0.25
    assert law_of("2.3 Lsun,0.03")(np.array([7.0])) == pytest.approx(wanted.to_value("K"), rel=1e-9)


def test_power_law_and_uniform_temperature():
    r = np.array([3.0, 12.0])
    assert law_of("150 K,3 au,0.4")(r) == pytest.approx(150 * (r / 3) ** -0.4)
    assert law_of(23 * u.K)(r) == pytest.approx([23.0, 23.0])


@pytest.mark.parametrize(
    "given", ["warm", "20 K,1 au", "20 K,1 au,x", "1 Lsun,2", "-3 K", "20 K,1 s,1", "nan K", "2 Lsun,0.1,3"]
)
def test_a_wrong_temperature_is_one_message(given):
    with pytest.raises(PlotError, match=r"^temperature: ") as error:
        law_of(given)
    assert "\n" not in str(error.value)
