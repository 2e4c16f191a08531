"""The report of a comparison: one HTML file that needs nothing beside it."""

from __future__ import annotations

import base64
import csv
import html
import io
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from .methods import REFERENCE, label_of
from .verdict import (
    RULES,
    conclusion,
    finding,
    has_figures,
    is_refused,
    next_command,
    title,
    total,
    trust_in_reference,
)
from .wording import percent, percent_signed, significant, unit_of_length

_LEGIBLE = 0.65  # of a plot's size: smaller letters cannot be read

_STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; max-width: 72rem; margin: 2rem auto; padding: 0 1rem; color: #222;
  overflow-wrap: break-word; } /* of long paths */
h1 { margin-bottom: 0; } .finding { font-size: 1.25rem; margin-top: .5rem; }
.conclusion { font-size: 1.1rem; }
/* A table that is too wide is scrolled under its first column, and a shade says that it goes on. */
.table { overflow-x: auto; background: linear-gradient(to left, #fff 30%, #fff0) right / 3rem 100% no-repeat local,
  linear-gradient(to left, #0003, #0000) right / 1rem 100% no-repeat scroll; }
table { border-collapse: collapse; margin: 1rem 0; font-variant-numeric: tabular-nums; }
th, td { padding: .25rem .6rem; border-bottom: 1px solid #ddd; text-align: right; }
td { white-space: nowrap; }
th { cursor: pointer; }
th:first-child, td:first-child { text-align: left; position: sticky; left: 0; background: #fff; }
@media (max-width: 40rem) { table { font-size: .85rem; }
  th:first-child, td:first-child { white-space: normal; min-width: 7rem; overflow-wrap: anywhere; } }
img { max-width: 100%; } pre { background: #f6f6f6; padding: 1rem; overflow-x: auto; font-size: .85rem; }
figure { margin: 1.5rem 0; overflow-x: auto; } figcaption { color: #555; font-size: .9rem; }
.row { display: grid; grid-template-columns: repeat(auto-fit, minmax(10.5rem, 1fr)); gap: .5rem; }
.row figure { margin: 0; text-align: center; }
"""


# A click on a table's head sorts its rows by that column, by the number that a cell begins with; cells of words come last.
_SCRIPT = """
const text = row => row.cells[column].textContent, number = row => parseFloat(text(row).replace(/^[<>] /, ""));
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


def springs_of(model: dict[str, Any]) -> str:
    """How many springs a model has, or patches of coupled springs, or both."""
    patches = f"{model['n_patches']} patches" if model["n_patches"] else ""
    return ", ".join(part for part in (str(model["n_springs"] or ""), patches) if part) or "0"


Table = tuple[list[str], list[list[str]]]


@dataclass(frozen=True)
class Row:
    """The reference and every model side by side, on one scale of error."""

    panels: list[tuple[str, str, Path]]  #: name, what is found of it, picture
    scale: str  #: SVG
    plot: str  #: SVG: how the errors are spread over the surface
    caption: str
    view: str  #: file beside the report


def tables(comparison: dict[str, Any]) -> tuple[Table, ...]:
    """Head and rows of the tables of errors, of trust and of seconds, for the terminal and for the report."""
    if "no_reference" in comparison:
        return (_table_alone(comparison["models"]),)
    reference, models = comparison["reference"], comparison["models"]
    stages = ["start-up", "mesh", "adapt", "setup", "assemble", "solve", "output"]
    used = {stage for of in (reference, *models.values()) for stage in of.get("seconds", {})}
    stages = [stage for stage in stages if stage in used or stage != "adapt"]
    aside = ["estimate"] if "estimate" in used else []  # in no total
    unit, size_of_unit = unit_of_length(reference["largest_displacement"])

    def times(seconds: dict[str, float]) -> list[str]:
        def of(names: list[str]) -> list[str]:
            return [f"{seconds[stage]:.2f}" if stage in seconds else "-" for stage in names]

        return [*of(stages), f"{total(seconds):.2f}", *of(aside)]

    def length(metres: float | None) -> str:
        return "-" if metres is None or metres != metres else significant(metres / size_of_unit)

    sizes = ["nodes", "springs", "dofs"]
    figures = ["displacement error", "at worst", "volume error", "area error", f"tip ({unit})"]
    errors: Table = (["", *sizes, *figures], [])
    exact = ["pressure", "uniaxial", "bending", "torsion"]
    trust: Table = (["exact fields", *exact, "floppy motions", "estimated error"], [])
    seconds: Table = (["seconds", *stages, "total", *aside], [])
    keys = ["displacement_error_l2", "displacement_error_max", "volume_change_error", "area_change_error"]
    for name, model in models.items():
        label = label_of(name)
        if not has_figures(model):
            status = "no result" if is_refused(model) else model["status"]
            errors[1].append([label, status, *[""] * (len(sizes + figures) - 1)])
            continue
        if model["status"] != "ok":
            label += f", up to {significant(model['reached'])} of the load"
        counts = [str(model["n_nodes"]), springs_of(model), str(3 * model["n_nodes"])]
        cells = [*(percent(model[key]) for key in keys), length(model["tip_displacement"])]
        errors[1].append([label, *counts, *cells])
        trust[1].append([label, *_trust(model)])
        seconds[1].append([label, *times(model["seconds"])])
    label = label_of(REFERENCE)
    if reference["n_refinements"]:
        cells = ["-", "-", "-", percent(reference["unrefined_error"]), "-", "-", "-", "-"]
        errors[1].append([f"{label}, unrefined", *cells])
        seconds[1].append([f"{label}, unrefined", *times(reference["unrefined_seconds"])])
        label += ", refined"
    counts = [str(reference["n_nodes"]), "-", str(reference["n_dofs"])]
    errors[1].append([label, *counts, *["-"] * len(keys), length(reference["largest_displacement"])])
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
                label_of(name), *size, significant(model["largest_displacement"]),
                percent(model["kinetic_energy_left"]), f"{model['seconds']['solve']:.2f}",
            ]
        )  # fmt: skip
    return head, rows


def _trust(model: dict[str, Any]) -> list[str]:
    """What the model as built makes of the exact fields, how far its network is a mechanism, and its own estimate."""
    measured = model.get("diagnostics") or {}
    floppy = model.get("n_floppy_motions")
    share = "unknown" if floppy is None else str(floppy)
    if floppy:
        share += f" ({percent(model['floppy_load_share'])} of the load)"
    keys = ("pressure_error", "uniaxial_error", "bending_error", "torsion_error")
    own = model.get("estimated_error")
    estimate = "-" if own is None else percent(own)
    return [*(percent(measured[key]) if key in measured else "-" for key in keys), share, estimate]


def text_of(comparison: dict[str, Any]) -> str:
    """The comparison for a terminal: finding, conclusion, tables, and how far the reference can be trusted."""
    parts = [f"{finding(comparison)}\n{' '.join(conclusion(comparison))}"]
    if "no_reference" not in comparison:
        parts.append(RULES)
    if step := next_command(comparison):
        purpose, command, cost = step
        parts.append(f"{purpose} (some {cost}):\n  {command}")
    parts += [text_table(head, rows) for head, rows in tables(comparison)]
    parts.append(" ".join([*trust_in_reference(comparison), *comparison.get("notes", [])]))
    return "\n\n".join(parts).rstrip()


def csv_table(head: list[str], rows: list[list[str]]) -> str:
    """One table for a file."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([head, *rows])
    return text.getvalue()


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
    """An SVG with its caption, for a page: where that is too narrow for its letters, it is scrolled."""
    width = re.search(r'width="([\d.]+)pt"', svg)
    least = f' style="min-width: {_LEGIBLE * float(width[1]):.0f}pt"' if width else ""
    return _figure(svg.encode(), "svg+xml", caption, least)


def image_figure(file: Path, caption: str) -> str:
    """A PNG, JPEG, GIF or WebP file with its caption, for a page."""
    return _figure(file.read_bytes(), _KINDS[file.suffix], caption)


_KINDS = {".png": "png", ".jpg": "jpeg", ".gif": "gif", ".webp": "webp"}


def _figure(data: bytes, kind: str, caption: str, look: str = "") -> str:
    return f"<figure>{_image(data, kind, look)}<figcaption>{html.escape(caption)}</figcaption></figure>"


def _image(data: bytes, kind: str, look: str = "") -> str:
    return f'<img src="data:image/{kind};base64,{base64.b64encode(data).decode()}" alt=""{look}>'


def html_table(head: list[str], rows: list[list[str]]) -> str:
    cells = [f"<tr>{''.join(f'<th>{html.escape(cell)}</th>' for cell in head)}</tr>"]
    cells += [f"<tr>{''.join(f'<td>{html.escape(cell)}</td>' for cell in row)}</tr>" for row in rows]
    return f'<div class="table"><table>{"".join(cells)}</table></div>'


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
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width">
<title>{html.escape(heading)}</title>
<style>{_STYLE}</style></head><body>
<h1>{html.escape(heading)}</h1>
<p class="finding">{html.escape(sentence)}</p>
{"".join(parts)}
{"<h2>Protocol</h2>" if details else ""}
{"".join(details)}
<script>{_SCRIPT}</script></body></html>
"""


def row_figure(row: Row) -> str:
    """Bodies side by side, as many as fit, above the scale that they share and the spread of their errors."""
    panels = [
        f"<figure>{_image(file.read_bytes(), _KINDS[file.suffix])}<figcaption><b>{html.escape(name)}</b><br>"
        f"{html.escape(found)}</figcaption></figure>"
        for name, found, file in row.panels
    ]
    return (
        f'<div class="row">{"".join(panels)}</div>{svg_figure(row.scale, row.caption)}'
        f'<p><a href="{row.view}">Turn the bodies in three dimensions</a> (a file beside this report).</p>'
        f"{svg_figure(row.plot, 'How the error is spread over the surface.')}"
    )


def render(
    comparison: dict[str, Any],
    row: Row | None,
    plots: dict[str, str],
    films: dict[str, Path],
    protocol: dict[str, str],
) -> str:
    """The whole report.

    row: None where there is no reference; plots: caption -> SVG; films: caption -> file; protocol: as in page.
    """
    parts = [f'<p class="conclusion">{html.escape(" ".join(conclusion(comparison)))}</p>']
    if "no_reference" not in comparison:
        parts.append(f"<p>{html.escape(RULES)}</p>")
    if step := next_command(comparison):
        purpose, command, cost = map(html.escape, step)
        parts.append(f"<p>{purpose} (some {cost}):</p><pre>{command}</pre>")
    if row:
        parts.append(row_figure(row))
    sentences = [_LAWS[comparison["law"]], *trust_in_reference(comparison), *comparison.get("notes", [])]
    parts.append(f"<p>{html.escape(' '.join(sentences))}</p>")
    parts += [html_table(*table) for table in tables(comparison)]
    parts += [svg_figure(svg, caption) for caption, svg in plots.items()]
    parts += [image_figure(file, caption) for caption, file in films.items()]
    parts.append(_EXPLAINED_ALONE if "no_reference" in comparison else _explained(comparison))
    return page(title(comparison), finding(comparison), parts, protocol)


_LAWS = {
    "small_strain": "Elasticity is that of small strain (material.law).",
    "neo_hookean": "Elasticity is neo-Hookean, at any strain (material.law).",
}

_EXPLAINED_ALONE = """<h2>How to read this</h2>
<p>No finite elements have solved this scene, so nothing is compared. <b>Kinetic energy
left</b>: at the end, of its largest; little means that the body came to rest without jitter.</p>"""


def _explained(comparison: dict[str, Any]) -> str:
    """What the figures of a comparison mean."""
    rigid = (
        "Rigid motion that nothing holds is removed from both displacements first. "
        if comparison["rigid_motion_removed"]
        else ""
    )
    kept = {
        "volume": "a hundredth of what the surface sweeps",
        "area": "a twentieth of what its triangles change by",
    }
    left_out = " ".join(
        f"The {part} changes by less than {of}, so its error is left out."
        for part, of in kept.items()
        if comparison["reference"][f"keeps_{part}"]
    )
    return f"""<h2>How to read this</h2>
<p>Both solvers start from the same surface, vertex by vertex. <b>Displacement error</b>: root mean square of the
difference at {comparison["reference"]["n_points"]} points of the surface as it was cut, at full load, of a dynamic scene
over its whole time, as a fraction of the root mean square of the finite-element displacement (L2 norms weighted by area).
<b>At worst</b>: the largest difference at a vertex over the same. {rigid}<b>Volume and area error</b>: L2 norm over the
whole curve of the difference in the change, as a fraction of the finite elements' own change. {left_out} <b>Tip</b>:
displacement of the vertex that moves farthest, in its direction.
<b>Exact fields</b>: what the model as built on this mesh makes of loads whose exact displacement is known, no reference
needed: the error of the surface's displacement under uniform pressure, uniaxial tension, bending and torsion.
<b>Floppy motions</b> cost a network no energy; a static solution holds them and carries the rest of the load. A network with
any gives no answer to the exact fields; motions in time do not count them. <b>Seconds</b>:
wall-clock, by stage. Residual and tolerance at which each solver stopped stand in its run.json below.</p>"""
