"""costs.csv is read as it was written; what is damaged is one message with its line."""

import pytest

from discsim.output.costtable import COLUMNS, CostsError, read_costs
from discsim.run.costs import Costs

HEAD = ",".join(COLUMNS)


def test_what_a_run_writes_is_read_again(tmp_path):
    costs = Costs(["gas", "drag"])
    costs.calls |= {"gas": 7, "drag": 3}
    costs.seconds |= {"gas": 1.5, "drag": 0.5}
    costs.write(tmp_path / "costs.csv")
    assert read_costs(tmp_path / "costs.csv") == [("gas", 7, 1.5, 0.75), ("drag", 3, 0.5, 0.25)]


@pytest.mark.parametrize(
    "content, wrong",
    [
        ("", ":1: not the header"), ("effect,calls\n", ":1: not the header"), (f"{HEAD}\ngas,7,1.5\n", ":2: not a row"),
        (f"{HEAD}\ngas,7,1.5,1\ndrag,x,0.5,0\n", ":3: not a row"), (f"{HEAD}\ngas,7,nan,1\n", ":2: not a row"),
        (f"{HEAD}\ngas,7,1e999,1\n", ":2: not a row"), (b"\xff\xfe", ": not a text table"),
        ("a\0b", ":1: not the header"), (f'{HEAD}\n"{"x" * 140_000}\n', ": not a text table"),
        (f"{HEAD}\n\n", ":2: not a row"),
    ],
)  # fmt: skip
def test_a_damaged_table_is_one_message(tmp_path, content, wrong):
    path = tmp_path / "costs.csv"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(CostsError) as fault:
        read_costs(path)
    assert str(fault.value).startswith(f"{path}{wrong}") and "x" * 20 not in str(fault.value)
