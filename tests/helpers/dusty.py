"""Gas and dust together, as tables of a scene."""

ISOTHERMAL = {"kind": "isothermal", "sound_speed": 1.0}


def scene(initial, until, drag, gas=40, dust=40, ratio=1.0, dimensions=1, **tables):
    gas = {"particles": gas, "eos": ISOTHERMAL} if isinstance(gas, int) else gas
    dust = {"particles": dust, "ratio": ratio} if isinstance(dust, int) else dust
    space = {"dimensions": dimensions, "size": 1.0, "boundary": "periodic"} | tables.pop("space", {})
    run = {"until": until} | tables.pop("run", {})
    return {
        "units": {"system": "code"}, "run": run, "space": space, "initial": initial,
        "gas": gas, "dust": dust, "drag": drag, **tables,
    }  # fmt: skip
