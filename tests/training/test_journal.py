"""Tables that can be taken back, and what is shown of a run."""

from __future__ import annotations

import io

from rich.console import Console

from posecast.training.journal import Display, Table


def test_a_table_reads_back_exactly(tmp_path):
    path = tmp_path / "log.csv"
    table = Table(path, 0)
    table.add(1, {"loss": 0.1 + 0.2, "updates": 6})
    table.add(2, {"loss": 1e-300, "updates": 12})
    assert path.read_text() == f"epoch,loss,updates\n1,{0.1 + 0.2!r},6\n2,1e-300,12\n"


def test_a_table_is_taken_back_to_an_epoch_and_goes_on(tmp_path):
    path = tmp_path / "log.csv"
    table = Table(path, 0)
    for epoch in range(1, 6):
        table.add(epoch, {"loss": epoch / 2})
    with path.open("a") as file:
        file.write("6")  # a kill in the middle of a row
    again = Table(path, 3)
    again.add(4, {"loss": 9.0})
    assert path.read_text() == "epoch,loss\n1,0.5\n2,1.0\n3,1.5\n4,9.0\n"


def test_a_table_of_an_earlier_run_is_begun_anew(tmp_path):
    path = tmp_path / "log.csv"
    Table(path, 0).add(1, {"loss": 1.0})
    Table(path, 0).add(1, {"error": 2.0})
    assert path.read_text() == "epoch,error\n1,2.0\n"


def test_a_row_with_other_names_adds_columns(tmp_path):
    path = tmp_path / "validation.csv"
    Table(path, 0).add(1, {"distance": 1.0, "angle": 3.0})
    again = Table(path, 1)
    again.add(2, {"npss": 0.5, "distance": 2.0})
    again.add(3, {"npss": 0.25, "distance": 4.0})
    assert path.read_text() == ("epoch,distance,angle,npss\n1,1.0,3.0,\n2,2.0,,0.5\n3,4.0,,0.25\n")


def test_a_table_that_is_gone_or_empty_is_begun_anew(tmp_path):
    empty = tmp_path / "empty.csv"
    empty.touch()
    for path in (empty, tmp_path / "gone.csv"):
        Table(path, 4).add(5, {"loss": 1.0})
        assert path.read_text() == "epoch,loss\n5,1.0\n"


def shown(*, terminal: bool, wanted: bool = True) -> str:
    """What three epochs write."""
    file = io.StringIO()
    console = Console(file=file, force_terminal=terminal, width=100)
    with Display(begin=7, epochs=10, shown=wanted, console=console) as display:
        for done in (8, 9, 10):
            display.update(done, {"loss": 0.123456, "euler": 0.9})
    return file.getvalue()


def test_a_log_file_gets_a_line_at_the_end_and_none_in_quick_succession():
    line = "training: epoch 10 of 10  loss 0.1235  euler 0.9  0.0 min left\n"
    assert shown(terminal=False) == line


def test_a_terminal_gets_a_bar():
    text = shown(terminal=True)
    assert "10/10" in text
    assert "loss 0.1235" in text
    assert "of 10" not in text


def test_nothing_is_shown_when_nothing_is_wanted():
    assert shown(terminal=False, wanted=False) == ""
    assert shown(terminal=True, wanted=False) == ""
