"""An exported file can be used with nothing but what it says of itself."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import torch
from tests.export.conftest import OFFSETS, SKELETON

import posecast
from posecast.corpora import build_corpus
from posecast.errors import ConfigError, DataError, SkeletonError
from posecast.export import export_step, record_of
from posecast.export.layout import feature_names
from posecast.model import rollout
from posecast.representation import REPRESENTATIONS, Codec, Controls, build_representation

FRAMES = 12


@pytest.fixture
def export(tmp_path):
    """Write a step; the path and what was measured."""

    def export(forecaster, **options):
        path = tmp_path / "step.onnx"
        return path, export_step(forecaster, path, offsets=OFFSETS, fps=25.0, **options)

    return export


def walk_by_record(path, prefix):
    """What a program in another language does: read the record, then step; no posecast."""
    import onnxruntime

    record = json.loads(path.with_suffix(".json").read_text("utf-8"))
    session = onnxruntime.InferenceSession(path, providers=["CPUExecutionProvider"])
    batch = len(prefix)
    state = []
    for part in record["initial_state"]:
        values = np.zeros(part["shape"]) if part["values"] is None else np.array(part["values"])
        rows = np.broadcast_to(values.reshape(1, *part["shape"]), (batch, *part["shape"]))
        state.append(np.ascontiguousarray(rows, dtype=np.float32))
    frames, frame = [], None
    for number in range(prefix.shape[1] + FRAMES - 1):
        read = prefix[:, number] if number < prefix.shape[1] else frame
        given = dict(zip(record["inputs"], [read, *state], strict=True))
        said = dict(zip(record["outputs"], session.run(record["outputs"], given), strict=True))
        frame = said[record["feed_back"]]
        state = [said[f"next_{part['name']}"] for part in record["initial_state"]]
        frames.append(said["next_features"])
    return np.stack(frames[-FRAMES:], axis=1)


@pytest.mark.parametrize("backbone", ["gru", "convolutional"])
@pytest.mark.parametrize("feedback", ["valid", "emitted"])
def test_the_record_is_all_that_a_walk_takes(backbone, feedback, make, motion, export, onnx_extra):
    forecaster = make(backbone, feedback=feedback)
    prefix = forecaster.codec.encode(motion)
    path, parity = export(forecaster)
    assert max(parity.differences.values()) < 1e-5
    found = walk_by_record(path, prefix.numpy())
    with torch.no_grad():
        wanted = rollout(forecaster, prefix, FRAMES).features
    np.testing.assert_allclose(found, wanted, atol=2e-5, rtol=0)


def test_the_record_says_what_the_numbers_are(make, export, onnx_extra):
    told = {"actions": ("run", "walk"), "controls": Controls()}
    path, parity = export(make(steered=True, codec_options=told))
    record = json.loads(record_of(path).read_text("utf-8"))
    assert record["skeleton"]["names"] == list(SKELETON.names)
    assert record["skeleton"]["parents"] == [-1, 0, 1, 1, 1]
    assert record["skeleton"]["offsets"] == [list(offset) for offset in OFFSETS]
    assert (record["format"], record["mode"], record["fps"]) == (1, "exact", 25.0)
    assert record["controls"] == list(Controls().names)
    assert record["feed_back"] == "next_features"
    assert record["features"][:5] == ["hips.w", "hips.x", "hips.y", "hips.z", "spine.w"]
    assert record["features"][20:] == [
        *("root.step_x", "root.height", "root.step_z"),
        *("action.run", "action.walk"),
    ]
    assert record["parity"] == parity.record()
    assert set(record["parity"]["versions"]) == {"torch", "onnx", "onnxscript", "onnxruntime"}


def test_the_file_says_the_same_and_nothing_of_the_machine_it_was_made_on(make, export, onnx_extra):
    import onnx

    path, _ = export(make())
    record = json.loads(record_of(path).read_text("utf-8"))
    record.pop("parity")
    (said,) = onnx.load(path).metadata_props
    assert said.key == "posecast"
    assert json.loads(said.value) == record
    content = path.read_bytes()
    for place in (Path(posecast.__file__).parent, Path(torch.__file__).parent, Path.home()):
        assert str(place).encode() not in content


def test_the_first_state_is_in_the_record_to_the_last_digit(make, export, onnx_extra):
    forecaster = make("lstm")
    path, _ = export(forecaster)
    parts = json.loads(record_of(path).read_text("utf-8"))["initial_state"]
    assert [part["name"] for part in parts] == ["state_0", "state_1", "state_2", "state_3"]
    for part, wanted in zip(parts, forecaster.initial_state(1), strict=True):
        assert torch.equal(torch.tensor(part["values"]), wanted[0])


@pytest.mark.parametrize("kind", REPRESENTATIONS)
def test_every_feature_has_a_name_of_its_own(kind):
    codec = Codec(SKELETON, build_representation(kind, SKELETON), "displacement", actions=("walk",))
    names = feature_names(codec)
    assert len(names) == len(set(names)) == codec.feature_dim
    assert names[0].startswith("hips.")


def test_euler_angles_are_named_in_their_order():
    codec = Codec(SKELETON, build_representation("euler", SKELETON, order="yzx"))
    assert feature_names(codec)[:3] == ["hips.angle_y", "hips.angle_z", "hips.angle_x"]


def test_a_fast_step_is_written_with_its_difference(make, export, onnx_extra):
    path, parity = export(make(backbone_options={"hidden": 160}), mode="fast")
    assert 1e-6 < max(parity.differences.values()) < 0.1
    assert json.loads(record_of(path).read_text("utf-8"))["mode"] == "fast"


def test_what_cannot_be_written_is_refused_and_nothing_is_left(make, tmp_path, onnx_extra):
    forecaster = make()
    sound = {"offsets": OFFSETS, "fps": 25.0}
    for name, changed, error, message in (
        ("step.bin", {}, ConfigError, r"ends in \.onnx"),
        ("none/step.onnx", {}, DataError, "there is no folder"),
        ("step.onnx", {"mode": "slow"}, ConfigError, "mode: 'slow'"),
        ("step.onnx", {"offsets": OFFSETS[:2]}, SkeletonError, "offsets of 2 joints; expected"),
        ("step.onnx", {"fps": 0.0}, ConfigError, "fps: 0.0; expected"),
    ):
        with pytest.raises(error, match=message):
            export_step(forecaster, tmp_path / name, **{**sound, **changed})
    with pytest.raises(ConfigError, match="representation 'matrix'"):
        export_step(make(representation="matrix"), tmp_path / "step.onnx", **sound)
    assert not list(tmp_path.iterdir())


@pytest.mark.data
def test_real_motion_goes_on_from_the_file_as_from_the_network(
    data_root, make, tmp_path, onnx_extra
):
    corpus = build_corpus("bandai-locomotion", root=data_root / "bandai-locomotion", fps=30.0)
    motion = corpus.gather(corpus.windows("test", 40)[:3], 40)
    skeleton = corpus.skeleton
    plain = Codec(skeleton, build_representation("quaternion", skeleton), "displacement")
    forecaster = make(
        codec=Codec(skeleton, plain.representation, "displacement", plain.measure([motion]))
    )
    prefix = forecaster.codec.encode(motion).float()
    offsets = corpus.clips[0].offsets.tolist()
    export_step(forecaster, tmp_path / "step.onnx", offsets=offsets, fps=30.0)
    found = walk_by_record(tmp_path / "step.onnx", prefix.numpy())
    with torch.no_grad():
        wanted = rollout(forecaster, prefix, FRAMES).features
    np.testing.assert_allclose(found, wanted, atol=2e-5, rtol=0)
