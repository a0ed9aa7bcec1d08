"""Snapshots and checkpoints that hold something else than was written, whole as HDF5 files: what a seed chooses.

Each way changes one entry, and returns what it did in words. All lies in the folder of the file: nothing else is read.
"""

import os

import h5py
import numpy as np

NO_TEXTS = [b"\xff\xfe title", b"title = ", b"[" * 3000, b"star = 3\n", b"title = 5\n", b"[star]\nmass = [1]\n", b""]
TYPES = ["S8", "c16", np.dtype([("a", "f8")]), h5py.string_dtype(), "f2", h5py.opaque_dtype(np.dtype("M8[s]"))]
ENDLESS = 10**12  # rows


def datasets(file, but=()):
    """Names of the datasets of a file, in order."""
    found = []
    file.visititems(lambda name, item: found.append(name) if isinstance(item, h5py.Dataset) else None)
    return sorted(name for name in found if not any(word in name for word in but))


def chosen(stream, entries):
    return entries[int(stream.integers(len(entries)))]


def replaced(file, name, data=None, **options):
    """Put another dataset in the place of one, with its attributes."""
    attributes = {key: file[name].attrs[key] for key in file[name].attrs}
    del file[name]
    stored = file.create_dataset(name, data=data, **options)
    for key, value in attributes.items():
        stored.attrs[key] = value


def lies_in_another_file(file, stream):
    name = chosen(stream, datasets(file))
    old, secret = file[name], os.path.join(os.path.dirname(file.filename), "secret")
    with open(secret, "wb") as other:
        other.write(bytes(range(1, 200)) * 2000)
    replaced(file, name, shape=old.shape, dtype=old.dtype, external=[(secret, 0, old.nbytes or 8)])
    return f"{name} with external storage"


def is_an_external_link(file, stream):
    name = chosen(stream, datasets(file))
    path = os.path.join(os.path.dirname(file.filename), "other.h5")
    with h5py.File(path, "w") as other:
        file.copy(name, other, "held")
    del file[name]
    file[name] = h5py.ExternalLink(path, "/held")
    return f"{name} behind an external link"


def is_a_link_to_a_fifo(file, stream):
    name, path = chosen(stream, datasets(file)), os.path.join(os.path.dirname(file.filename), "fifo.h5")
    os.mkfifo(path)
    del file[name]
    file[name] = h5py.ExternalLink(path, "/held")
    return f"{name} behind a link to a FIFO"


def is_a_soft_link(file, stream):
    name = chosen(stream, datasets(file))
    file["elsewhere"] = file[name]
    del file[name]
    file[name] = h5py.SoftLink("/elsewhere")
    return f"{name} behind a soft link"


def is_virtual(file, stream):
    name = chosen(stream, [name for name in datasets(file) if file[name].size])
    path = os.path.join(os.path.dirname(file.filename), "other.h5")
    with h5py.File(path, "w") as other:
        file.copy(name, other, "held")
    shape, dtype = file[name].shape, file[name].dtype
    layout = h5py.VirtualLayout(shape, dtype)
    layout[:] = h5py.VirtualSource(path, "held", shape)
    attributes = dict(file[name].attrs)
    del file[name]
    stored = file.create_virtual_dataset(name, layout)
    for key, value in attributes.items():
        stored.attrs[key] = value
    return f"{name} in a virtual dataset"


def has_parts_elsewhere(file, stream):
    names = [b"../secret", b"/elsewhere/a.h5", b"parts/../x", b"parts/", b"elsewhere/a.h5"]
    file.attrs["parts"] = np.array([chosen(stream, names)])
    file.attrs["made"] = np.bytes_("abc")
    return "parts elsewhere"


def is_endless(file, stream):
    name = chosen(stream, datasets(file))
    old, chunked = file[name], bool(stream.integers(2))
    shape = (ENDLESS, *old.shape[1:])
    replaced(file, name, shape=shape, dtype=old.dtype, chunks=(4096, *old.shape[1:]) if chunked else None)
    return f"{name} of {ENDLESS} rows that nobody wrote"


def is_of_another_type(file, stream):
    name, dtype = chosen(stream, datasets(file)), chosen(stream, TYPES)
    replaced(file, name, shape=file[name].shape, dtype=dtype)
    return f"{name} of type {dtype}"


def is_of_another_shape(file, stream):
    names = datasets(file, but=("Scene", "scene/text", "costs"))
    name = chosen(stream, [name for name in names if file[name].size])
    old = file[name][()]
    narrow = old[0] if old.ndim == 1 else old[:, :1]
    shapes = [old[:-1], np.concatenate([old, old]), old[..., None], old.reshape(1, -1), narrow]
    data = chosen(stream, [array for array in shapes if array.shape != old.shape])
    replaced(file, name, data)
    return f"{name} of shape {data.shape}, not {old.shape}"


def is_not_finite(file, stream):
    names = datasets(file, but=("discsim/OpenStep/bodies", "Stopping", "Stokes", "seconds", "SubcycleClock"))
    name = chosen(stream, [name for name in names if file[name].dtype.kind == "f" and file[name].size])
    data = file[name][()]
    data.flat[int(stream.integers(data.size))] = chosen(stream, [np.nan, np.inf, -np.inf])
    replaced(file, name, data)
    return f"a number of {name} that is not finite"


def is_out_of_range(file, stream):
    name = chosen(stream, [name for name in datasets(file) if name.split("/")[-1] in BOUNDED and file[name].size])
    data = file[name][()]
    whole = data.dtype.kind in "iu"
    data[int(stream.integers(len(data)))] = chosen(stream, [-1, 99, 2**40] if whole else [-0.3, -1e300])
    replaced(file, name, data)
    return f"{name} out of range"


def is_no_group(file, stream):
    groups = []
    file.visititems(lambda name, item: groups.append(name) if isinstance(item, h5py.Group) else None)
    name = chosen(stream, sorted(set(groups) & NEEDED))
    del file[name]
    file[name] = np.ones(3)
    return f"{name} is a dataset"


def is_gone(file, stream):
    needed = (*BOUNDED, "pos", "Coordinates", "text", "Scene", "calls", "accreted_gas")
    name = chosen(stream, [name for name in datasets(file) if name.split("/")[-1] in needed])
    del file[name]
    return f"without {name}"


def has_no_scene(file, stream):
    name, text = "discsim/Scene" if "discsim" in file else "arrays/scene/text", chosen(stream, NO_TEXTS)
    replaced(file, name, np.frombuffer(text, np.uint8) if text else np.empty(0, np.uint8))
    return f"a scene {text[:20]!r}"


def has_another_attribute(file, stream):
    there = [(path, name) for path, name in ATTRIBUTES if path in file and name in file[path].attrs]
    path, name = chosen(stream, there)
    value = chosen(stream, [np.bytes_(b"\xff\xfe"), np.full(3, np.nan), np.nan, "words", h5py.Empty("f8"), -7.5])
    file[path].attrs[name] = value
    return f"{path}@{name} = {value!r}"


def has_another_count(file, stream):
    """Ways to damage a checkpoint."""
    name = chosen(stream, ["snapshots", "step", "rows", "lag", "limit", "put_out", "time", "dt"])
    halves = [0.5] if name in ("snapshots", "step", "rows") else []
    value = chosen(stream, [-1, -(2**62), np.nan, -np.inf, True, *halves])
    file["values"].attrs[name] = value
    return f"values@{name} = {value}"


BOUNDED = ("Masses", "SmoothingLengths", "Species", "mass", "h", "h_before", "species")
NEEDED = {
    "Header", "discsim", "PartType0", "PartType3", "values",
    "arrays", "arrays/gas", "arrays/dust", "arrays/scene", "arrays/own_acc", "arrays/ledger", "arrays/costs",
}  # fmt: skip
ATTRIBUTES = [
    ("/", "discsim"), ("/", "version"), ("discsim", "units"), ("discsim", "dimensions"), ("discsim", "origin"),
    ("discsim", "size"), ("discsim", "support"), ("Header", "Time"), ("values", "limited_by"),
    ("values", "set_by"), ("values", "time"), ("values", "snapshots"),
]  # fmt: skip
WAYS = [
    lies_in_another_file, is_an_external_link, is_a_link_to_a_fifo, is_a_soft_link, is_virtual, has_parts_elsewhere,
    is_endless, is_of_another_type, is_of_another_shape, is_not_finite, is_out_of_range, is_no_group, is_gone,
    has_no_scene, has_another_attribute,
]  # fmt: skip
OF_CHECKPOINTS = [*WAYS, has_another_count]


def mangle(path, ways, seed):
    """Change one entry of the file at `path`; what was done, in words."""
    stream = np.random.default_rng([56, seed])
    with h5py.File(path, "r+") as file:
        return ways[seed % len(ways)](file, stream)


def odd_files(folder, content):
    """Paths at which there is no HDF5 file of ours: what commands may be given by mistake."""
    names = ("fifo.h5", "folder.h5", "empty.h5", "cut.h5", "text.h5")
    fifo, directory, empty, cut, text = (folder / name for name in names)
    os.mkfifo(fifo)
    directory.mkdir()
    empty.touch()
    cut.write_bytes(content[: len(content) // 2])
    text.write_text("# r Sigma\n1 2\n")
    with h5py.File(folder / "other.h5", "w") as file:
        file["PartType0/Masses"] = np.ones(3)
    return [fifo, directory, empty, cut, text, folder / "other.h5", folder / "absent.h5"]
