"""The report of a comparison: one HTML file that needs nothing beside it."""

from __future__ import annotations

import base64
import html
import math
from pathlib import Path
from typing import Any

from .methods import REFERENCE, label_of

_STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; max-width: 62rem; margin: 2rem auto; padding: 0 1rem; color: #222; }
h1 { margin-bottom: 0; } .finding { font-size: 1.25rem; margin-top: .5rem; }
table { border-collapse: collapse; margin: 1rem 0; font-variant-numeric: tabular-nums; }
th, td { padding: .25rem .75rem; border-bottom: 1px solid #ddd; text-align: right; }
th { cursor: pointer; } th:first-child, td:first-child { text-align: left; }
img { max-width: 100%; } pre { background: #f6f6f6; padding: 1rem; overflow-x: auto; font-size: .85rem; }
figure { margin: 1.5rem 0; } figcaption { color: #555; font-size: .9rem; }
"""


# A click on a table's head sorts its rows by that column, by the number that a cell begins with; cells of words come last.
_SCRIPT = """
const number = row => parseFloat(row.cells[column].textContent), text = row => row.cells[column].textContent;
let column = 0;
for (const head of document.querySelectorAll("th")) head.onclick = () => {
  column = head.cellIndex;
  const table = head.closest("table"), rows = [...table.rows].slice(1), words = r => isNaN(number(r));
  const sign = table.dataset.sorted === String(column) ? -1 : 1;
  table.dataset.sorted = sign > 0 ? String(column) : "";
  rows.sort((a, b) => words(a) - words(b) || sign * (words(a) ? text(a).localeCompare(text(b)) : number(a) - number(b)));
  for (const row of rows) row.parentNode.append(row);
};
"""


def percent(fraction: float | None) -> str:
    """A fraction as a percentage of three digits."""
    if fraction is None or math.isnan(fraction):
        return "-"
    value = 100 * fraction
    return f"{value:.3g} %" if 1e-3 <= value < 1e4 or value == 0 else f"{value:.1e} %"


def percent_signed(fraction: float) -> str:
    return f"{'-' if fraction < 0 else '+'}{percent(abs(fraction))}"


def total(seconds: dict[str, float]) -> float:
    return sum(seconds.values())


def title(comparison: dict[str, Any]) -> str:
    return f"{comparison['scene']}, {comparison['surface']}"


def finding(comparison: dict[str, Any]) -> str:
    """What the comparison found, in one sentence."""
    name, model = comparison["calibration"], comparison["models"][comparison["calibration"]]
    if model["status"] != "ok":
        return f"{title(comparison)}: the {name} springs gave no result: {model['status']}."
    if "no_reference" in comparison:
        return (
            f"{title(comparison)}: no fair reference ({comparison['no_reference']}); the volume of the "
            f"{name} springs ends {percent(abs(model['volume_change']))} {'below' if model['volume_change'] < 0 else 'above'} "
            f"that at rest, and {percent(model['kinetic_energy_left'])} of the largest kinetic energy is left; they took "
            f"{total(model['seconds']):.2g} s."
        )
    springs, fem = total(model["seconds"]), total(comparison["reference"]["seconds"])
    ratio = f"{fem / springs:.2g} times faster" if fem >= springs else f"{springs / fem:.2g} times slower"
    own = comparison["reference"]["estimated_error_l2"]
    blur = f"; the reference's own error is some {percent(own)}" if is_blurred(model, own) else ""
    sentence = (
        f"{title(comparison)}: the {name} springs miss the finite elements' surface displacement by "
        f"{percent(model['displacement_error_l2'])} (at worst {percent(model['displacement_error_max'])}{blur})"
    )
    if is_nearly_isochoric(comparison["reference"]):
        sentence += (
            ", their volume, which changes by less than a hundredth of what the surface sweeps, "
            f"by {percent(model['volume_change_difference'])} of itself"
        )
    else:
        sentence += f" and their volume change by {percent(model['volume_change_error'])}"
    return f"{sentence}; they took {springs:.2g} s against {fem:.2g} s, {ratio}."


def is_blurred(model: dict[str, Any], error_of_reference: float | None) -> bool:
    """Whether the reference's own error exceeds a tenth of the model's difference from it."""
    return (error_of_reference or 0) > max(_ROUNDING, model["displacement_error_l2"] / 10)


def trust_in_reference(comparison: dict[str, Any]) -> list[str]:
    """Sentences: the reference's own error, and which differences it is too large for."""
    if "no_reference" in comparison:
        return []
    error = comparison["reference"]["estimated_error_l2"]
    if error is None:
        return ["The error of the finite elements themselves is not estimated for this scene."]
    if error < _ROUNDING:
        return ["The finite elements' own error is rounding, as a refinement shows."]
    own = f"The finite elements' own displacement error is some {percent(error)}, estimated by a refinement"
    blurred = [
        f"{name} ({percent(error / model['displacement_error_l2'])} of it)"
        for name, model in comparison["models"].items()
        if model["status"] == "ok" and is_blurred(model, error)
    ]
    if not blurred:
        return [f"{own}: less than a tenth of every difference."]
    return [
        f"{own}: more than a tenth of the difference from {', '.join(blurred)}, which is to be taken with that care."
    ]


def is_nearly_isochoric(reference: dict[str, Any]) -> bool:
    """True when the volume changes by less than a hundredth of what the surface sweeps: bending, torsion."""
    return reference["largest_volume_change"] < 0.01 * reference["swept_volume"]


def springs_of(model: dict[str, Any]) -> str:
    """How many springs a model has, or patches of coupled springs, or both."""
    patches = f"{model['n_patches']} patches" if model["n_patches"] else ""
    return ", ".join(part for part in (str(model["n_springs"] or ""), patches) if part) or "0"


_ROUNDING = 1e-8
Table = tuple[list[str], list[list[str]]]


def tables(comparison: dict[str, Any]) -> tuple[Table, ...]:
    """Head and rows of the tables of errors, of trust and of seconds, for the terminal and for the report."""
    if "no_reference" in comparison:
        return (_table_alone(comparison["models"]),)
    reference, models = comparison["reference"], comparison["models"]
    stages = ["mesh", "setup", "assemble", "solve", "output"]

    def times(seconds: dict[str, float]) -> list[str]:
        known = [f"{seconds[stage]:.2f}" if stage in seconds else "-" for stage in stages]
        return [*known, f"{total(seconds):.2f}"]

    errors: Table = (["", "nodes", "springs", "dofs", "displacement error", "largest", "volume error"], [])
    trust: Table = (
        [
            "exact fields",
            "pressure",
            "uniaxial",
            "bending compliance",
            "torsion compliance",
            "floppy motions",
        ],
        [],
    )
    seconds: Table = (["seconds", *stages, "total"], [])
    keys = ["displacement_error_l2", "displacement_error_max", "volume_change_error"]
    for name, model in models.items():
        label = label_of(name)
        if model["status"] != "ok":
            errors[1].append([label, model["status"], *[""] * 5])
            continue
        size = [str(model["n_nodes"]), springs_of(model), str(3 * model["n_nodes"])]
        cells = [percent(model[key]) for key in keys]
        if is_nearly_isochoric(reference):
            cells[-1] = "-"  # a fraction of next to nothing
        errors[1].append([label, *size, *cells])
        trust[1].append([label, *_trust(model)])
        seconds[1].append([label, *times(model["seconds"])])
    label = label_of(REFERENCE)
    errors[1].append([label, str(reference["n_nodes"]), "-", str(reference["n_dofs"]), "-", "-", "-"])
    seconds[1].append([label, *times(reference["seconds"])])
    return errors, trust, seconds


def _table_alone(models: dict[str, dict[str, Any]]) -> Table:
    head = [
        "",
        "nodes",
        "springs",
        "volume change",
        "largest displacement (m)",
        "kinetic energy left",
        "solve (s)",
    ]
    rows = []
    for name, model in models.items():
        if model["status"] != "ok":
            rows.append([label_of(name), model["status"], *[""] * 5])
            continue
        size = [str(model["n_nodes"]), springs_of(model), percent_signed(model["volume_change"])]
        rows.append(
            [
                label_of(name), *size, f"{model['largest_displacement']:.3g}",
                percent(model["kinetic_energy_left"]), f"{model['seconds']['solve']:.2f}",
            ]
        )  # fmt: skip
    return head, rows


def _trust(model: dict[str, Any]) -> list[str]:
    """What the model as built makes of the exact fields, and how far its network is a mechanism."""
    measured = model.get("diagnostics") or {}
    floppy = model.get("n_floppy_motions") or 0
    share = f"{floppy} ({percent(model['floppy_load_share'])} of the load)" if floppy else "0"
    errors = [
        percent(measured[key]) if key in measured else "-" for key in ("pressure_error", "uniaxial_error")
    ]
    ratios = [
        f"{measured[key]:.3f}" if key in measured else "-"
        for key in ("bending_compliance", "torsion_compliance")
    ]
    return [*errors, *ratios, share]


def text_tables(comparison: dict[str, Any]) -> str:
    """The tables for a terminal, and how far the reference can be trusted."""
    parts = [text_table(head, rows) for head, rows in tables(comparison)]
    return "\n\n".join([*parts, *trust_in_reference(comparison)])


def text_table(head: list[str], rows: list[list[str]]) -> str:
    """One table for a terminal."""
    widths = [max(map(len, column)) for column in zip(head, *rows, strict=True)]
    lines = [
        "  ".join(
            [
                row[0].ljust(widths[0]),
                *(cell.rjust(width) for cell, width in zip(row[1:], widths[1:], strict=True)),
            ]
        )
        for row in [head, *rows]
    ]
    return "\n".join(line.rstrip() for line in lines)


def svg_figure(svg: str, caption: str) -> str:
    """An SVG with its caption, for a page."""
    return _figure(svg.encode(), "svg+xml", caption)


def image_figure(file: Path, caption: str) -> str:
    """A PNG or GIF file with its caption, for a page."""
    return _figure(file.read_bytes(), file.suffix[1:], caption)


def _figure(data: bytes, kind: str, caption: str) -> str:
    source = f"data:image/{kind};base64,{base64.b64encode(data).decode()}"
    return f'<figure><img src="{source}" alt=""><figcaption>{html.escape(caption)}</figcaption></figure>'


def html_table(head: list[str], rows: list[list[str]]) -> str:
    cells = [f"<tr>{''.join(f'<th>{html.escape(cell)}</th>' for cell in head)}</tr>"]
    cells += [f"<tr>{''.join(f'<td>{html.escape(cell)}</td>' for cell in row)}</tr>" for row in rows]
    return f"<table>{''.join(cells)}</table>"


def page(heading: str, sentence: str, parts: list[str], protocol: dict[str, str]) -> str:
    """One self-contained HTML file.

    sentence: the finding it opens with; parts: HTML, such as svg_figure and html_table give; protocol: name -> text of
    all that is needed to repeat it.
    """
    details = [
        f"<details><summary>{html.escape(name)}</summary><pre>{html.escape(text)}</pre></details>"
        for name, text in protocol.items()
    ]
    return f"""<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>{html.escape(heading)}</title>
<style>{_STYLE}</style></head><body>
<h1>{html.escape(heading)}</h1>
<p class="finding">{html.escape(sentence)}</p>
{"".join(parts)}
<h2>Protocol</h2>
{"".join(details)}
<script>{_SCRIPT}</script></body></html>
"""


def render(
    comparison: dict[str, Any],
    plots: dict[str, str],
    pictures: dict[str, Path],
    protocol: dict[str, str],
) -> str:
    """The whole report.

    plots: caption -> SVG; pictures: caption -> PNG file; protocol: as in page.
    """
    sentences = [_LAWS[comparison["law"]], *trust_in_reference(comparison)]
    parts = [f"<p>{html.escape(sentence)}</p>" for sentence in sentences]
    parts += [html_table(*table) for table in tables(comparison)]
    parts += [svg_figure(svg, caption) for caption, svg in plots.items()]
    parts += [image_figure(file, caption) for caption, file in pictures.items()]
    parts.append(_EXPLAINED_ALONE if "no_reference" in comparison else _explained(comparison))
    return page(title(comparison), finding(comparison), parts, protocol)


_LAWS = {
    "small_strain": "Elasticity is that of small strain (material.law).",
    "neo_hookean": "Elasticity is neo-Hookean, at any strain (material.law).",
}

_EXPLAINED_ALONE = """<h2>How to read this</h2>
<p>Contact, friction, wrinkles and skin have no fair finite-element reference here, so nothing is compared. <b>Kinetic energy
left</b>: at the end, of its largest; little means that the body came to rest without jitter.</p>"""


def _explained(comparison: dict[str, Any]) -> str:
    """What the figures of a comparison mean."""
    rigid = (
        "The body is free, so rigid motion is removed from both displacements first. "
        if comparison["rigid_motion_removed"]
        else ""
    )
    return f"""<h2>How to read this</h2>
<p>Both solvers start from the same surface, vertex by vertex. <b>Displacement error</b>: area-weighted L2 norm over
the surface nodes of the difference at full load, of a dynamic scene over the whole time too, as a fraction of the same
norm of the finite-element displacement; <b>largest</b>: greatest difference at a node over the greatest finite-element
displacement. {rigid}
<b>Volume error</b>: L2 norm over the whole curve of the difference in volume change, as a fraction of the finite
elements' own; left out where that stays below a hundredth of what the surface sweeps
({percent(comparison["reference"]["largest_volume_change"])} here, while the surface sweeps
{percent(comparison["reference"]["swept_volume"])}). <b>Exact fields</b>: what the model as built
on this mesh makes of loads whose exact displacement is known, no reference needed: error under uniform pressure and
uniaxial tension, compliance over the exact one in bending and torsion (1 is exact, less too stiff). <b>Floppy
motions</b> cost a network no energy; a static solution holds them and carries the rest of the load. A network with
any gives no answer to the exact fields. <b>Seconds</b>: wall-clock, by stage. Residual and
tolerance at which each solver stopped stand in its run.json below.</p>"""
