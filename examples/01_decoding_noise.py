"""How far hands, feet and head move when the numbers of a pose are a little wrong.

A network is never quite right. The same noise is put on the features of three representations, and
every joint at an end of the body is placed by them. With local rotations the errors of all joints
above add up; root-relative dual quaternions say where the joint is (Andreou et al. 2022, Figure 2).
What is the same noise is a choice: as large on every number (``--units absolute``), or as large a
share of each number's standard deviation, as a network sees it (``--units relative``).

    python examples/01_decoding_noise.py --out decoding_noise.png
    python examples/01_decoding_noise.py --corpus cmu-salsa --root DIR --units absolute
"""

from __future__ import annotations

import argparse
from pathlib import Path

import torch
from torch import Tensor

from posecast.corpora import build_corpus
from posecast.motion import Corpus, Motion
from posecast.representation import Codec, build_representation
from posecast.skeleton import joint_positions
from posecast.viewer.plots import lines

NOISE = {"relative": (0.0, 0.02, 0.05, 0.1, 0.2, 0.4), "absolute": (0.0, 0.01, 0.02, 0.04, 0.08)}
WAYS = {
    "quaternion": "local quaternions, placed by forward kinematics",
    "ortho6d": "local 6D rotations, placed by forward kinematics",
    "dual_quaternion": "root-relative dual quaternions, as they are",
    "dual_quaternion on the body": "the same, their rotations placed by forward kinematics",
}


def main() -> None:
    """Print the table and draw the plot."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--corpus", default="synthetic")
    parser.add_argument("--root", type=Path)
    parser.add_argument("--units", choices=list(NOISE), default="relative")
    parser.add_argument("--out", type=Path, default=Path("decoding_noise.png"))
    arguments = parser.parse_args()
    corpus = build_corpus(arguments.corpus, root=arguments.root, fps=30)
    noises = NOISE[arguments.units]
    errors = {way: [error(corpus, way, noise, arguments.units) for noise in noises] for way in WAYS}
    print(f"error of the joints at the ends of the body, cm, mean; {arguments.units} noise")
    print("noise".ljust(30), *(f"{noise:>7g}" for noise in noises))
    for way, values in errors.items():
        print(way.ljust(30), *(f"{value:7.2f}" for value in values))
    for way in list(WAYS)[1:]:
        ratio = errors["quaternion"][2] / errors[way][2]
        print(f"at noise {noises[2]:g}, quaternions are {ratio:.2f} times as far off as {way}")
    unit = "standard deviations" if arguments.units == "relative" else "on every number"
    lines(
        {WAYS[way]: list(zip(noises, values, strict=True)) for way, values in errors.items()},
        arguments.out,
        across=f"noise on the features ({unit})",
        upright="error of hands, feet and head (cm)",
        title=f"Decoding noisy features: {arguments.corpus}",
    )


def error(corpus: Corpus, way: str, noise: float, units: str) -> float:
    """Mean distance of end joints from where they should be, centimeters."""
    kind, _, on_body = way.partition(" ")
    codec = Codec(corpus.skeleton, build_representation(kind, corpus.skeleton))
    motion = clips_of(corpus)
    scale = codec.measure([motion]).scale
    moves = scale != 1  # what never moves a network gets right
    scale = torch.where(moves, scale if units == "relative" else torch.ones_like(scale), 0.0)
    features = codec.encode(motion).double()
    generator = torch.Generator().manual_seed(0)
    drawn = torch.randn(features.shape, generator=generator, dtype=torch.float64)
    wrong = codec.split(features + noise * scale * drawn).joints
    representation = codec.representation
    valid = representation.project(wrong)
    bodies = motion.offsets.double()[:, None]
    truth = joint_positions(corpus.skeleton, motion.rotations_local.double(), bodies)
    stated = None if on_body else representation.positions(valid)
    if stated is None:
        rotations = representation.decode(valid, bodies)
        stated = joint_positions(corpus.skeleton, rotations, bodies)
    found = stated - stated[..., :1, :]
    ends = [j for j, below in enumerate(corpus.skeleton.children) if not below]
    return 100 * float(distance(found, truth - truth[..., :1, :])[..., ends].mean())


def clips_of(corpus: Corpus) -> Motion:
    """Windows of two seconds from all test clips."""
    length = round(2 * corpus.fps)
    return corpus.gather(corpus.windows("test", length, stride=length), length)


def distance(found: Tensor, true: Tensor) -> Tensor:
    """Length of the difference."""
    return torch.linalg.vector_norm(found - true, dim=-1)


if __name__ == "__main__":
    main()
