"""What a comparison says in sentences: the finding, a conclusion by plain rules, and how far the reference can be trusted."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

from .wording import about, duration, listed, seconds, share, significant
from .wording import percent_in_words as percent

SERVES, FAILS = (
    0.05,
    0.2,
)  # displacement errors: up to the first a model serves, beyond the second it does not
_SAVED = 0.8  # of the finite elements' seconds, at most: single runs vary by a fifth
_AT_REST = 0.01  # of the largest kinetic energy
_SAME_VOLUME = 0.02  # of that at rest: what a step may change
_ROUNDING = 1e-8
_ELSEWHERE = 0.25  # of the displacement error: surfaces that are nearer, of points that are not
_NOTICED = 0.01  # error of small strain on both sides: it is no part of their difference
_OTHER_LAW = 'material.law = "neo_hookean"'

_AS_NEAR = 1.1  # times the finite elements' error, at most: errors are equal
_BEST = "node_averaged"
_OF_A_QUARTER = ("uniform", "affine")  # models whose Poisson's ratio is 1/4 for any material
_NOTICED_RESISTANCE = 0.4
_TARGET = 0.02  # of adaptive springs
_ACROSS = 3  # edges that fit across a body
# Seconds of a run over those of this one, roughly: springs adapted, triangles cut three times as fine, another law.
_ADAPTED, _FINER, _NEAR_SUPPORTS, _LARGE_STRAIN = 30, 4, 2, 5

RULES = (
    f"A model serves where it is off by at most {percent(SERVES)}, and does not beyond {percent(FAILS)}. The finite elements' "
    "own error is added or taken off, whichever is worse for the statement; where that matters, or is not known, the run cannot "
    f"decide. Time is saved where all stages together take at most {percent(_SAVED)} of the finite elements' seconds at no "
    "larger error."
)


def title(comparison: dict[str, Any]) -> str:
    return f"{comparison['scene']}, {comparison['surface']}"


def of_solution(stages: dict[str, float]) -> dict[str, float]:
    """The stages of a run but for the estimate of its own error, which counts in no comparison."""
    return {stage: time for stage, time in stages.items() if stage != "estimate"}


def total(stages: dict[str, float]) -> float:
    return sum(of_solution(stages).values())


def has_figures(model: dict[str, Any]) -> bool:
    """Whether the model gave a result, be it of a part of the load."""
    return "seconds" in model


def finding(comparison: dict[str, Any]) -> str:
    """What the comparison found, in one sentence: of two errors that outdo the difference, or the difference itself."""
    name, model = comparison["calibration"], comparison["models"][comparison["calibration"]]
    if not has_figures(model):
        return f"{title(comparison)}: the {name} springs gave no result: {model['status']}."
    if "no_reference" in comparison:
        return (
            f"{title(comparison)}: no fair reference ({comparison['no_reference']}); the volume of the "
            f"{name} springs ends {percent(abs(model['volume_change']))} {'below' if model['volume_change'] < 0 else 'above'} "
            f"that at rest, and {percent(model['kinetic_energy_left'])} of the largest kinetic energy is left."
        )
    reference, difference = comparison["reference"], model["displacement_error_l2"]
    own = reference["estimated_error_l2"]
    thin = f"{_too_thin(comparison)}; " if _serves_alone(comparison) and comparison["is_too_thin"] else ""
    stops = thin + "".join(f"{stop}; there " for stop in _stops(comparison))
    if is_out_of_range(model, reference):
        found = (
            f"the finite elements, being of small strain, are off by {about(reference['law_error'])}, "
            f"while the {name} springs differ from them by {percent(difference)}"
        )
    elif (own or 0) > max(_ROUNDING, difference):
        found = (
            f"the finite elements' own displacement error, {about(own)}, exceeds the {percent(difference)} by which "
            f"the {name} springs differ from them"
        )
    else:
        blur = f"; the reference's own error is {about(own)}" if is_blurred(model, own) else ""
        found = (
            f"the {name} springs miss the finite elements' surface displacement by {percent(difference)} "
            f"(at worst {percent(model['displacement_error_max'])}{blur})"
        )
        if goes_elsewhere(model):
            found += f", though their surfaces lie {percent(model['surface_distance'])} of it apart,"
        if not reference["keeps_volume"]:
            found += f" and their volume change by {percent(model['volume_change_error'])}"
    return f"{title(comparison)}: {stops}{found}."


def _serves_alone(comparison: dict[str, Any]) -> bool:
    """Whether the finite elements are near enough by themselves where no spring model is."""
    reference = comparison["reference"]
    models = [model for model in comparison["models"].values() if has_figures(model)]
    own = reference["estimated_error_l2"]
    return (
        own is not None
        and own <= SERVES
        and all(verdict_on(model, reference) in ("not", "between") for model in models)
        and not any(is_out_of_range(model, reference) for model in models)
    )


def _too_thin(comparison: dict[str, Any]) -> str:
    return (
        "the body is too thin for its surface, so that finite elements serve here and springs do not "
        f"({_of_elements(comparison['reference'])})"
    )


def _of_elements(reference: dict[str, Any]) -> str:
    off = f"off by {about(reference['estimated_error_l2'])}"
    return f"they are {off}, in {seconds(total(reference['seconds']))}"


def _stops(comparison: dict[str, Any]) -> list[str]:
    """Who stopped on the way, the reference or the scene's own model, in words."""
    reference, model = comparison["reference"], comparison["models"][comparison["calibration"]]
    stops = []
    if reference["stopped"]:
        stops.append(_stop("the finite elements", reference["reached"], reference["stopped"]))
    if model["status"] != "ok" and has_figures(model):
        stops.append(_stop(f"the {comparison['calibration']} springs", model["reached"], model["status"]))
    return stops


def _stop(who: str, reached: float, why: str) -> str:
    return f"{who} stopped at load factor {significant(reached)} ({why})"


def is_blurred(model: dict[str, Any], error_of_reference: float | None) -> bool:
    """Whether the reference's own error exceeds a tenth of the model's difference from it."""
    return (error_of_reference or 0) > max(_ROUNDING, model["displacement_error_l2"] / 10)


def is_out_of_range(model: dict[str, Any], reference: dict[str, Any]) -> bool:
    """Whether small strain costs the reference more than a tenth of the model's difference from it.

    Where the model leaves out the same, errors below _NOTICED are no news.
    """
    least = _NOTICED if model["is_linear"] else _ROUNDING
    return is_blurred(model, reference["law_error"]) and reference["law_error"] > least


def goes_elsewhere(model: dict[str, Any]) -> bool:
    """Whether points differ far more than surfaces do, as in bodies that roll, fold or wrinkle where chance decides."""
    apart = model["surface_distance"]
    return apart is not None and apart < _ELSEWHERE * model["displacement_error_l2"]


def conclusion(comparison: dict[str, Any]) -> list[str]:
    """Sentences by RULES: which models to use here, which not, what time that saves, and what limits the statement."""
    models = {name: model for name, model in comparison["models"].items() if has_figures(model)}
    if "no_reference" in comparison:
        calm = [name for name, model in models.items() if model["kinetic_energy_left"] < _AT_REST]
        came = f"{listed(calm) or 'none'} came to rest" if models else "none gave a result"
        return [
            f"No model can be recommended here, as there is no reference to judge it by; {came}.",
            *_on_half_step(comparison),
            *_on_busy_machine(models.values()),
        ]
    reference = comparison["reference"]
    groups: dict[str, list[str]] = {"use": [], "not": [], "between": [], "undecided": []}
    # Models that differ by rounding stay in the scene's order.
    for name, model in sorted(
        models.items(), key=lambda item: max(_ROUNDING, item[1]["displacement_error_l2"])
    ):
        groups[verdict_on(model, reference)].append(name)

    def named(group: str, last: str) -> str:
        return listed(
            [f"{name} ({percent(models[name]['displacement_error_l2'])})" for name in groups[group]], last
        )

    if groups["use"]:
        but = f", not {named('not', 'or')}" if groups["not"] else ""
        sentences = [f"Use {named('use', 'or')} here{but}."]
    else:
        but = f"; do not use {named('not', 'or')}" if groups["not"] else ""
        sentences = [f"No model is shown to serve here{but}."]
    if groups["between"]:
        sentences.append(f"{named('between', 'and')} {_verb(groups['between'], 'lies', 'lie')} in between.")
    if groups["undecided"]:
        sentences.append(f"This run cannot decide on {named('undecided', 'or')}.")
    if groups["use"]:
        best = groups["use"][0]
        sentences.append(_time_saved(best, models[best], reference))
    elif _serves_alone(comparison):
        far = groups["not"] if len(groups["not"]) > 1 and not groups["between"] else []
        sentences += [f"All models are far off, {far[0]} the least."] if far else []
        sentences.append(f"The finite elements serve here: {_of_elements(reference)}.")
    return sentences + _limits(comparison, groups)


def _time_saved(name: str, model: dict[str, Any], reference: dict[str, Any]) -> str:
    """Of a model that serves, which is only said where it is as near to the finest reference as the scene's elements are."""
    error, of_elements = model["displacement_error_finest"], reference["unrefined_error"]
    if error is None or of_elements is None:
        return "Nothing is said on time, as the finite elements' own error is not known."
    if model["has_waited"] or reference["unrefined_has_waited"]:
        return "Nothing is said on time, as the machine was busy."
    springs, elements = total(model["seconds"]), total(reference["unrefined_seconds"])
    took = f"{name} took {seconds(springs)} and the finite elements {seconds(elements)}"
    off = f"off by {percent(error, 2)} and {percent(of_elements, 2)} by refined ones"
    if error > max(_ROUNDING, _AS_NEAR * of_elements):
        return f"{took}, at unequal errors ({off}): nothing is said on time saved."
    saved = seconds(elements - springs) if springs <= _SAVED * elements else "no time"
    return f"{took}, {off}: it saves {saved}."


def is_refused(model: dict[str, Any]) -> bool:
    """Whether a model ended with an error in words, instead of a status."""
    return not has_figures(model) and " " in model["status"].split(", ")[0]


def needs_finer_reference(comparison: dict[str, Any]) -> bool:
    """Whether a statement on a model, or the target of adaptive springs, waits for a smaller error of the reference's."""
    reference = comparison["reference"]
    own = reference["estimated_error_l2"]
    if own is None or own > max(_ROUNDING, comparison["target_error"] or 1):
        return True
    models = [model for model in comparison["models"].values() if has_figures(model)]
    exact = reference | {"estimated_error_l2": 0.0}
    return any(verdict_on(model, reference) == "undecided" != verdict_on(model, exact) for model in models)


def next_command(comparison: dict[str, Any]) -> tuple[str, str, str] | None:
    """What would settle or mend the verdict: what for, the command, and what it costs.

    None where a model serves, or where chance decides.
    """
    if "no_reference" in comparison:
        return None
    reference, command = comparison["reference"], comparison["command"]
    models = {name: model for name, model in comparison["models"].items() if has_figures(model)}
    groups = {name: verdict_on(model, reference) for name, model in models.items()}
    if any(map(goes_elsewhere, models.values())):
        return None
    spent = sum(total(of["seconds"]) for of in (reference, *models.values()))

    def step(purpose: str, setting: str, times: float) -> tuple[str, str, str]:
        return purpose, f"{command} --set {setting}", duration(times * spent)

    undecided = [name for name, group in groups.items() if group == "undecided"]
    if any(is_out_of_range(models[name], reference) for name in undecided):
        return step("To leave the limits of small strain", "material.law=neo_hookean", _LARGE_STRAIN)
    if undecided and reference["next_seconds"] and not reference["unrefined"]:
        limit = math.ceil(reference["next_seconds"])
        return "To decide", f"{command} --time-limit {limit}", f"{duration(limit)} more"
    if undecided:
        return step("To refine the finite elements in smaller steps", comparison["smaller_steps"], 2)
    if "use" in groups.values():
        return None
    if _BEST not in comparison["models"]:
        return step("To try a model that may serve", f"network.calibration={_BEST}", 1)
    if is_refused(comparison["models"][_BEST]):
        return None
    if _BEST not in models or models[_BEST]["status"] != "ok":
        return step(f"To bring {_BEST} to the end in smaller steps", comparison["smaller_steps"], 2)
    if any("--remesh" in note for note in comparison["notes"]):
        return "To have even triangles", f"{command} --remesh", duration(spent)
    if comparison["is_coarse_at_supports"]:
        return step(
            "To make springs and elements finer where supports end", "surface.at_supports=1", _NEAR_SUPPORTS
        )
    is_cut = (reference["n_cut"] > 0 or not comparison["is_static"]) and not comparison["is_too_thin"]
    if is_cut and comparison["across"] < _ACROSS:
        return step("To make springs and elements finer", f"surface.across={_ACROSS}", _FINER)
    if comparison["is_static"] and not comparison["target_error"]:
        adapted = f"{command} --set network.calibration={_BEST} --set network.target_error={_TARGET}"
        cost = duration(_ADAPTED * total(models[_BEST]["seconds"]))
        return "To add nodes where springs need them", adapted, cost
    finer = f"surface.across={significant(2 * max(comparison['across'], 1))}"
    return step("To make springs and elements finer", finer, _FINER)


def verdict_on(model: dict[str, Any], reference: dict[str, Any]) -> str:
    """Whether a model serves ("use"), does not ("not"), lies "between", or "undecided"."""
    error, own = model["displacement_error_l2"], reference["estimated_error_l2"]
    if own is None:
        return "undecided"
    if is_out_of_range(model, reference):
        own += reference["law_error"]
    if error + own <= SERVES:
        return "use"
    if error - own > FAILS:
        return "not"
    return "between" if error - own > SERVES and error + own <= FAILS else "undecided"


def _limits(comparison: dict[str, Any], groups: dict[str, list[str]]) -> list[str]:
    reference, models = comparison["reference"], comparison["models"]
    own = reference["estimated_error_l2"]
    limits = []
    if any(is_out_of_range(models[name], reference) for group in groups.values() for name in group):
        limits.append(f"Set {_OTHER_LAW} to leave the limits of small strain.")
    if own is None:
        limits.append(_why_not_estimated(reference))
    elif any(is_blurred(models[name], own) for group in groups.values() for name in group):
        limits.append(f"The finite elements' own error of {about(own)} limits this.")
    figures = {"the reference": reference} | {f"{name} springs": model for name, model in models.items()}
    if elsewhere := [name for group in groups.values() for name in group if goes_elsewhere(models[name])]:
        limits.append(
            f"Points of {listed(elsewhere)} go elsewhere along nearly the same surface, as where chance decides how a body rolls "
            "or folds. Judge by volume, area and the surfaces' distance there."
        )
    if inverted := [
        name for name, of in figures.items() if (least := of.get("least_jacobian")) is not None and least <= 0
    ]:
        limits.append(f"Tetrahedra of {listed(inverted)} were turned inside out.")
    mechanisms = [
        name for group in ("use", "undecided") for name in groups[group] if models[name]["n_floppy_motions"]
    ]
    if mechanisms:
        limits.append(
            f"{listed(mechanisms)} {_verb(mechanisms, 'is a mechanism', 'are mechanisms')}, whose error another load may change."
        )
    if plain := [name for name in _OF_A_QUARTER if has_figures(models.get(name, {}))]:
        resists = 0.5 / (1 - 2 * comparison["nu"])  # a change of volume, over what it would at nu = 1/4
        if abs(resists - 1) > _NOTICED_RESISTANCE:
            limits.append(
                f"The springs of {listed(plain)} have a Poisson's ratio of 1/4, whatever material.nu is: at "
                f"{comparison['nu']:g} the material resists a change of volume {significant(resists, 2)} times as much as they "
                "do."
            )
    if networks := [name for group in groups.values() for name in group if models[name]["n_springs"]]:
        limits.append(
            f"{listed(networks)} {_verb(networks, 'stands', 'stand')} on one random network, and another gives another error."
        )
    return [
        *limits,
        *(
            _on_busy_machine([reference, *models.values()])
            or ["Seconds are of single runs, whose errors differ."]
        ),
    ]


def _on_half_step(comparison: dict[str, Any]) -> list[str]:
    """How far springs without a reference depend on their step."""
    half = comparison["half_step_volume_change"]
    if half is None:
        return []
    model = comparison["models"][comparison["calibration"]]
    left, half_left = 1 + model["volume_change"], 1 + half
    if abs(left - half_left) <= _SAME_VOLUME:
        return [
            f"Half the step changes the volume at its end by {percent(abs(left - half_left))} of that at rest."
        ]
    return [
        f"This depends on its step: {percent(left)} of the volume is left, and {percent(half_left)} at half the step."
    ]


def _on_busy_machine(runs: Iterable[dict[str, Any]]) -> list[str]:
    """What its seconds are worth, of a run that waited."""
    if not any(run.get("has_waited") for run in runs):
        return []
    return ["The machine was busy with other things: seconds are longer than they would be alone."]


def _why_not_estimated(reference: dict[str, Any]) -> str:
    """One sentence."""
    unknown = "The finite elements' own error is not estimated"
    if reference["unrefined"]:
        return f"{unknown}: refined, they gave nothing ({reference['unrefined']})."
    cost = reference["next_seconds"]
    return f"{unknown}: a refinement takes some {duration(cost)}." if cost else f"{unknown}."


def _verb(names: list[str], one: str, several: str) -> str:
    return one if len(names) == 1 else several


def trust_in_reference(comparison: dict[str, Any]) -> list[str]:
    """Sentences: the reference's own error and that of its law, and which differences they are too large for."""
    if "no_reference" in comparison:
        return []
    models = {name: model for name, model in comparison["models"].items() if has_figures(model)}
    reference = comparison["reference"]
    refined = []
    if n := reference["n_refinements"]:
        times = "once" if n == 1 else f"{n} times"
        refined = [f"The finite elements were refined {times}, as a coarser mesh could not decide."]
    return [*refined, _own_error(reference, models), *_law_error(reference, models)]


def _own_error(reference: dict[str, Any], models: dict[str, dict[str, Any]]) -> str:
    error = reference["estimated_error_l2"]
    if error is None:
        return _why_not_estimated(reference)
    if error < _ROUNDING:
        return "The finite elements' own error is rounding, as a refinement shows."
    own = f"The finite elements' own displacement error is {about(error)}, estimated by a refinement"
    blurred = [
        f"{name} ({share(error / model['displacement_error_l2'])})"
        for name, model in models.items()
        if is_blurred(model, error)
    ]
    if not blurred:
        return f"{own}: less than a tenth of every difference."
    return f"{own}: more than a tenth of the difference from {listed(blurred)}, which is to be taken with that care."


def _law_error(reference: dict[str, Any], models: dict[str, dict[str, Any]]) -> list[str]:
    if not reference["law_error"] or reference["law_error"] < _ROUNDING:
        return []
    angle = math.degrees(reference["rotation"])
    sentences = [
        f"All but a twentieth of the surface turns by at most {significant(max(angle, 0.1), 2)} degrees and strains by at "
        f"most {percent(reference['strain'], 2)}: an answer of small strain is off by {about(reference['law_error'])}."
    ]
    out = [name for name, model in models.items() if is_out_of_range(model, reference)]
    if out:
        sentences.append(
            f"That is more than a tenth of the difference from {listed(out)}: set {_OTHER_LAW} in the scene."
        )
    return sentences
