"""Scene files that somebody has mistyped: each is read, or told with its file and line; never a traceback."""

import re
from collections import Counter

import numpy as np
import pytest
from fuzz import EXTREME

from discsim.preview.check import report
from discsim.scene import SceneError, load_scene
from setups import SETUPS

NUMBER = 3000
WORDS = ["nan", "-inf", "1e400", '"1 au"', '"x', "[1, 2", "{kind = 3}", "''", "1979-05-27", "0x10", "'''", "= 1"]
LETTERS = ' "=[]{}.,#_-\n\t0159aeEkxé\x00\x7f\u2028'


def mistyped(text, stream):
    """The text with one to three mistakes."""
    for _ in range(stream.integers(1, 4)):
        lines = text.splitlines() or [""]
        number, place = int(stream.integers(len(lines))), int(stream.integers(len(text) + 1))
        line = lines[number]
        match stream.integers(8):
            case 0:
                del lines[number]
            case 1:
                lines.insert(int(stream.integers(len(lines))), line)
            case 2 if "=" in line:
                value = EXTREME[stream.integers(len(EXTREME))]
                value = WORDS[stream.integers(len(WORDS))] if value is None else str(value).replace("'", '"')
                lines[number] = f"{line.split('=')[0]}= {value}"
            case 3:
                other = lines[int(stream.integers(len(lines)))]
                lines[number] = line.split("=")[0] + "=" + other.split("=")[-1]
            case 4:
                lines = lines[: number + 1]
            case 5:
                lines.append(line)
            case _:
                letter = LETTERS[stream.integers(len(LETTERS))]
                lines = (text[:place] + letter + text[place + int(stream.integers(2)) :]).split("\n")
        text = "\n".join(lines)
    return text


@pytest.mark.parametrize("part", range(10))
def test_mistyped_scenes(tmp_path, part):
    """A tenth of them."""
    path, ends = tmp_path / "a.toml", Counter()
    texts = [setup.read_text() for setup in SETUPS]
    for seed in range(part * NUMBER // 10, (part + 1) * NUMBER // 10):
        stream = np.random.default_rng([15, seed])
        path.write_bytes(mistyped(texts[stream.integers(len(texts))], stream).encode())
        try:
            scene = load_scene(path)
            ends["read"] += 1
            assert report(scene)
        except SceneError as error:
            ends["refused"] += 1
            assert error.problems
            for problem in error.problems:
                assert re.match(rf"{re.escape(str(path))}:\d+: ", problem), (seed, problem)
                assert "\n" not in problem and len(problem) < 700, (seed, problem)
        except Exception as error:
            error.add_note(f"seed {seed}: {path.read_text()}")
            raise
    print(f"{sum(ends.values())} scenes: {dict(ends)}")
    assert min(ends.values()) > 10
