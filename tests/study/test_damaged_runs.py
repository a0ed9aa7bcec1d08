"""The runs that a study has kept: what is damaged is one message with its line, and nothing is changed."""

import json

import pytest

from discsim.study.points import StudyError
from discsim.study.runs import RUNS, Runs

SCENE = """
units.system = "code"
run.until = 1.3
space = {size = 2, boundary = "periodic"}
initial.kind = "box"
gas = {particles = 90, eos = {kind = "isothermal", sound_speed = 0.7}}
"""


@pytest.mark.parametrize("line", ["{", "3", "[]", "{}", '{"settings": 3}', "\x00", "[" * 9000, "\udcff"])
def test_a_damaged_run_of_a_study_is_one_message(tmp_path, line):
    (tmp_path / "a.toml").write_text(SCENE)
    runs, path = Runs(tmp_path / "a.toml", tmp_path), tmp_path / RUNS
    assert runs.open_record({"varied": ["x"]}) == []
    runs.record({"x": "3"}, {"cpu": 1.5})
    assert runs.open_record({"varied": ["x"]}) == [({"x": "3"}, {"cpu": 1.5})]
    with path.open("ab") as file:
        file.write(line.encode(errors="surrogateescape") + b"\n")
    before = path.read_bytes()
    with pytest.raises(
        StudyError, match=f"{RUNS}:3: the line is not a run of a study; choose another directory with -o"
    ):
        runs.open_record({"varied": ["x"]})
    assert path.read_bytes() == before and json.loads(before.splitlines()[1])["cpu"] == 1.5
