"""What ``posecast reproduce`` does: a table of a paper, its numbers and ours side by side."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from posecast.cli.compared import Contestant
from posecast.cli.comparing import check_runs, contest, write
from posecast.cli.reproduced import Found, Reproduction
from posecast.cli.terminal import read_corpus, say
from posecast.corpora import CORPORA
from posecast.errors import ConfigError
from posecast.evaluation import (
    BASELINE_NAMES,
    METRICS,
    Protocol,
    build_protocol,
    keypoint_curve,
    make_baseline,
)
from posecast.evaluation.reproduced import (
    PrintedTable,
    choose_rows,
    printed_table,
    printed_tables,
    small_form,
)
from posecast.motion.corpus import Corpus
from posecast.recipe import Recipe, load_recipe


def list_tables() -> str:
    """All tables, and what stands for each of their rows here."""
    blocks: list[str] = []
    for name, table in printed_tables().items():
        rows = [f"  {row}: {system}" for row, system in table.rows.items()]
        blocks.append("\n".join([f"{name} ({table.protocol}): {table.title}", *rows]))
    return "\n\n".join(blocks)


def reproduce_table(
    name: str,
    wanted: Sequence[str],
    overrides: Sequence[str],
    out: Path,
    *,
    roots: Mapping[str, Path],
    corpus: str | None,
    seeds: int,
    small: bool,
    progress: bool = True,
) -> str:
    """Train and score what a table needs; write ``TABLE.md`` and ``TABLE.json`` into ``out``.

    With ``TABLE.png``, a curve of correct joints a system, where positions are in thighs.

    It may be stopped at any moment; the same call goes on. Runs are in ``out/RECIPE/SEED``.

    Args:
        name: of the table, see ``list_tables``.
        wanted: rows by the paper's names or ours; none: all.
        overrides: of every recipe.
        out: folder.
        roots: folders of corpora, by kind.
        corpus: kind of corpus in the place of the recipes'.
        seeds: runs of each recipe, with the seeds 0, 1, ...
        small: take the small forms of the recipes.
        progress: show how far training is, on standard error.

    Returns:
        The report, in Markdown.

    Raises:
        ConfigError: no such table or row, nothing can be done as data are missing, or a run in
            ``out`` has other settings; nothing is trained then.
    """
    plan = _plan(
        printed_table(name), wanted, overrides, roots=roots, corpus=corpus, seeds=seeds, small=small
    )
    data = _read([[plan.first], *plan.ready.values()], roots)
    for each in data.values():
        plan.protocol.windows(each)
    for runs in plan.ready.values():
        check_runs(runs, data[_key(runs[0])], out)
    beside = data[_key(plan.first)]
    found: list[Found] = []
    for row, system in plan.rows.items():
        if row in plan.ready:
            runs = plan.ready[row]
            found.append(_train(row, runs, plan.protocol, data[_key(runs[0])], out, progress))
        elif system in BASELINE_NAMES:
            baseline = make_baseline(system, beside)
            scores = plan.protocol.score(baseline, beside, system=system)
            found.append(Found(row, system, (scores,), baseline))
    out.mkdir(parents=True, exist_ok=True)  # baselines alone leave no runs there
    _draw(found, plan.protocol, beside, out / f"{name}.png")
    report = Reproduction(plan.table, found, plan.absent, list(data.values()), plan.comparable)
    text = report.to_markdown()
    write(out / f"{name}.md", text)
    write(out / f"{name}.json", json.dumps(report.to_json(), indent=1) + "\n")
    return text


@dataclass(frozen=True, eq=False)
class _Plan:
    """What is to be done for a table.

    Args:
        table: which.
        rows: printed name -> our recipe or baseline, in the order of the table.
        ready: of the rows to be trained whose recordings are there, all seeds.
        absent: of those whose recordings are not, the kind of corpus.
        first: the recipe as which baselines are scored.
        protocol: for all.
        comparable: whether the paper's numbers may stand beside ours.
    """

    table: PrintedTable
    rows: Mapping[str, str]
    ready: Mapping[str, Sequence[Recipe]]
    absent: Mapping[str, str]
    first: Recipe
    protocol: Protocol
    comparable: bool


def _plan(
    table: PrintedTable,
    wanted: Sequence[str],
    overrides: Sequence[str],
    *,
    roots: Mapping[str, Path],
    corpus: str | None,
    seeds: int,
    small: bool,
) -> _Plan:
    """Say what is to be done, or that it cannot be; see ``reproduce_table``."""
    if seeds < 1:
        raise ConfigError(f"--seeds {seeds}: expected 1 or more")
    keys = {each.partition("=")[0].strip() for each in overrides}
    if keys & {"name", "training.seed"}:
        raise ConfigError("name and training.seed tell the runs apart; leave them out")

    def load(system: str, seed: int) -> Recipe:
        return _load(system, [*overrides, f"training.seed={seed}"], roots, corpus, small=small)

    rows = choose_rows(table, wanted)
    trained = [row for row, system in rows.items() if system not in BASELINE_NAMES]
    recipes = {row: [load(rows[row], seed) for seed in range(seeds)] for row in trained}
    ready = {row: runs for row, runs in recipes.items() if _has_data(runs[0], roots)}
    # Baselines are scored as the systems beside them, or as the table's first would be.
    beside = next(system for system in table.rows.values() if system not in BASELINE_NAMES)
    first = next(iter(ready.values()))[0] if ready else load(beside, 0)
    if not ready and (trained or not _has_data(first, roots)):
        kinds = table.corpora if corpus is None else (corpus,)
        raise ConfigError(
            f"{table.name}: no row has its data; give "
            + " or ".join(f"--root {kind}=DIR" for kind in kinds)
        )
    own = any(key.split(".")[0] == "protocol" for key in keys - {"protocol.metrics"})
    return _Plan(
        table,
        rows,
        ready,
        {row: _kind(runs[0]) for row, runs in recipes.items() if row not in ready},
        first,
        _one_protocol(table, first, ready, own=own),
        comparable=not own and _kind(first) in table.corpora,
    )


def _load(
    system: str,
    overrides: Sequence[str],
    roots: Mapping[str, Path],
    corpus: str | None,
    *,
    small: bool,
) -> Recipe:
    """A recipe, on the first release of AMASS if that is what there is of AMASS."""
    name = small_form(system) if small else system
    if corpus is None and "amass-first" in roots and "amass" not in roots:
        given = load_recipe(name, overrides)
        corpus = "amass-first" if _kind(given) == "amass" else None
    return load_recipe(name, overrides, corpus=corpus)


def _one_protocol(
    table: PrintedTable, first: Recipe, ready: Mapping[str, Sequence[Recipe]], *, own: bool
) -> Protocol:
    """The table's protocol, or that which somebody gave or a corpus of another kind needs.

    Raises:
        ConfigError: rows would be scored under different ones, or on different corpora.
    """
    made = {row: _protocol(table, runs[0], own=own) for row, runs in ready.items()}
    chosen = _protocol(table, first, own=own)
    for row, runs in ready.items():
        alike = repr(made[row]) == repr(chosen) and _kind(runs[0]) == _kind(first)
        if not alike or runs[0].fps != first.fps:
            raise ConfigError(
                f"{table.name}: rows {next(iter(ready))!r} and {row!r} would be scored under "
                "different protocols or on different corpora; give the same corpus and "
                "protocol={kind: ..., ...} for all, or do them one by one"
            )
    return chosen


def _kind(recipe: Recipe) -> str:
    return str(recipe.config["corpus"]["kind"])


def _has_data(recipe: Recipe, roots: Mapping[str, Path]) -> bool:
    """Whether the recordings of a recipe are there, or it needs none."""
    return _kind(recipe) in roots or _kind(recipe) == "synthetic"


def _key(recipe: Recipe) -> str:
    """Recipes with one key read the same corpus."""
    return json.dumps([recipe.config["corpus"], recipe.fps], sort_keys=True)


def _read(recipes: Iterable[Sequence[Recipe]], roots: Mapping[str, Path]) -> dict[str, Corpus]:
    """Every corpus once."""
    data: dict[str, Corpus] = {}
    for runs in recipes:
        recipe = runs[0]
        if _key(recipe) not in data:
            data[_key(recipe)] = read_corpus(recipe, roots.get(_kind(recipe)))
    return data


def _protocol(table: PrintedTable, recipe: Recipe, *, own: bool) -> Protocol:
    """That of the table with its horizons; the recipe's where that is wanted or must be."""
    if own or _kind(recipe) not in table.corpora:
        return recipe.protocol
    options = dict(recipe.config["protocol"])
    if options["kind"] != table.protocol:
        options = {"kind": table.protocol}
    return build_protocol(**{**options, "horizons_ms": list(table.horizons_ms)})


def _train(
    row: str,
    runs: Sequence[Recipe],
    protocol: Protocol,
    corpus: Corpus,
    out: Path,
    progress: bool,
) -> Found:
    """All seeds of a row."""
    done: Contestant = contest(runs, corpus, protocol, out, progress=progress)
    return Found(
        row,
        runs[0].name,
        done.report.runs,
        done.runs[0].predictor,
        done.cost.parameters,
        tuple(done.cost.seconds),
        runs[0].plan.epochs,
    )


def parse_roots(given: Sequence[str]) -> dict[str, Path]:
    """``["h36m=data/h36m"]`` as folders by kind of corpus.

    Raises:
        ConfigError: no ``=``, an unknown kind, or a folder that is none.
    """
    roots: dict[str, Path] = {}
    for each in given:
        kind, equals, folder = each.partition("=")
        if not equals or kind not in CORPORA:
            raise ConfigError(
                f"--root {each}: expected KIND=DIR with a corpus among {', '.join(CORPORA)}"
            )
        if not Path(folder).is_dir():
            raise ConfigError(f"--root {each}: {folder} is not a folder")
        roots[kind] = Path(folder)
    return roots


def _draw(found: Sequence[Found], protocol: Protocol, corpus: Corpus, path: Path) -> None:
    """How many joints are within which distance until the last horizon, where thighs are known."""
    if not any("thigh" in METRICS[metric].asks for metric in protocol.metrics):
        return
    from posecast.viewer.plots import lines

    until = protocol.horizons_ms[-1]
    lines(
        {
            each.system: keypoint_curve(each.predictor, protocol, corpus, horizon_ms=until)
            for each in found
        },
        path,
        across="threshold (thighs)",
        upright="share of joints within it (PCK)",
        title=f"Correct joints until {until:g} ms, {protocol.name} on {corpus.name}",
    )
    say(f"{path} written")
