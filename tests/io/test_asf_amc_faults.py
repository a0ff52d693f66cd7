"""Damaged ASF/AMC files are refused with file, line and reason."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.io.asf_amc_reference import AMC, ASF

from posecast.errors import DataError
from posecast.io.asf import read_asf
from posecast.io.asf_amc import read_amc


@pytest.fixture
def trial(tmp_path: Path) -> Path:
    (tmp_path / "07.asf").write_text(ASF)
    (tmp_path / "07_01.amc").write_text(AMC)
    return tmp_path / "07_01.amc"


AMC_FAULTS = {
    "cut in a frame": (AMC[: AMC.rindex("thigh")], "ends without 2 of its bones", 11),
    "cut in a row": (AMC[: AMC.rindex(" 9")], "2 values for 'thigh', expected 3.*copy it", 12),
    "cut in a name": (AMC[: AMC.rindex("high")], "bone 't' is not in.*cut off, copy it", 12),
    "a value too many": (AMC.replace("5 -6", "5 -6 1"), "3 values for 'back'.*mend the line", 6),
    "bone lacks": (AMC.replace("back 5 -6\n", ""), r"frame 1 ends without 1.*\(back\)", 8),
    "bone twice": (AMC.replace("shin -10", "back 1 2\nshin -10"), "'back' stands twice", 8),
    "strange bone": (AMC.replace("back 5 -6", "tail 5 -6"), "'tail' is not in 07.asf", 6),
    "not a number": (AMC.replace("5.5", "5,5"), "'5,5', expected a finite number", 11),
    "NaN": (AMC.replace("5.5", "nan"), "'nan', expected a finite number", 11),
    "overflow": (AMC.replace("5.5", "5e999"), "'5e999', expected a finite number", 11),
    "underscore": (AMC.replace("5.5", "5_5"), "'5_5', expected a finite number", 11),
    "frame lost": (AMC.replace("\n2\n", "\n3\n"), "frame 3, expected 2", 9),
    "no frame number": (AMC.replace("\n1\n", "\n"), "'root', expected a frame number", 4),
    "header only": (AMC[: AMC.index("1\n")], "no frames", None),
    "empty": ("", "is empty", None),
    "binary": ("\x00\x01" + AMC, "zero byte at position 0", None),
}


@pytest.mark.parametrize("fault", AMC_FAULTS)
def test_a_damaged_motion_is_refused_with_line_and_reason(trial, fault):
    text, message, line = AMC_FAULTS[fault]
    trial.write_text(text)
    with pytest.raises(DataError, match=message) as caught:
        read_amc(trial)
    assert caught.value.line == line
    assert str(caught.value).startswith(str(trial))


ASF_FAULTS = {
    "no hierarchy": (ASF[: ASF.index(":hierarchy")], "no section ':hierarchy'", None),
    "cut in a bone": (
        ASF[: ASF.rindex("axis 15")] + ":hierarchy\nroot hip\n",
        "bone data are cut off",
        None,
    ),
    "bone without length": (ASF.replace("     length 7\n", ""), "'shin' has no 'length'", None),
    "bone without name": (ASF.replace("     name hip\n", ""), "no 'name'", None),
    "bone named twice": (
        ASF.replace("name shin", "name thigh"),
        "'thigh', expected one that no other",
        37,
    ),
    "unknown child": (ASF.replace("thigh shin", "thigh foot"), "no bone is called 'foot'", 57),
    "two parents": (ASF.replace("thigh shin", "thigh shin hip"), "'hip' has a second parent", 57),
    "unconnected": (ASF.replace("    thigh shin\n", ""), r"does not connect \['shin'\]", None),
    "circle": (
        ASF.replace("root back hip", "root back").replace("thigh shin", "thigh shin hip"),
        "does not connect",
        None,
    ),
    "bad axis": (ASF.replace("30 XYZ", "30 XYY"), "axis order 'xyy'", 29),
    "bad number": (ASF.replace("0.6 -0.8 0", "0.6 -0.8 up"), "'up', expected a finite", 20),
    "too few numbers": (ASF.replace("0.6 -0.8 0", "0.6"), "1 values, expected 3", 20),
    "stretching bone": (ASF.replace("dof rz rx", "dof rz l"), "slide or stretch", 50),
    "dof twice": (ASF.replace("dof rz rx", "dof rz rz"), "at most once", 50),
    "unit zero": (ASF.replace("length 0.45", "length 0"), "unit of length 0", 6),
    "unit of angle": (ASF.replace("angle deg", "angle grad"), "'grad', expected deg or rad", 7),
    "root without order": (ASF.replace("   order TX TY TZ RX RY RZ\n", ""), "no 'order'", None),
    "empty": (" \n", "is empty", None),
}


@pytest.mark.parametrize("fault", ASF_FAULTS)
def test_a_damaged_skeleton_is_refused_with_line_and_reason(trial, fault):
    text, message, line = ASF_FAULTS[fault]
    asf = trial.with_name("07.asf")
    asf.write_text(text)
    with pytest.raises(DataError, match=message) as caught:
        read_asf(asf)
    assert caught.value.line == line
    assert caught.value.path == str(asf)


def test_missing_files_and_folders_are_refused(tmp_path):
    with pytest.raises(DataError, match="there is no such file"):
        read_amc(tmp_path / "01_01.amc")
    with pytest.raises(DataError, match="not a regular file"):
        read_amc(tmp_path)
    (tmp_path / "01_01.amc").write_text(AMC)
    with pytest.raises(DataError, match="there is no such file"):
        read_amc(tmp_path / "01_01.amc", tmp_path / "02.asf")
