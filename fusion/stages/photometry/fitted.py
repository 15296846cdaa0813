"""``photometry.json``: photometric functions fitted to the images of a solution."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from functools import partial
from typing import Any

from fusion.runtime import Executor, Progress
from fusion.stages.photometry.sampling import (
    FilterSamples,
    PhotometryOptions,
    ranges,
    sampled_filters,
)
from fusion.workspace import Workspace
from spcola.errors import SettingsError
from spcola.photometry.fitting import (
    Doubt,
    PhotometricFit,
    PhotometricSamples,
    Standing,
    compare_fits,
    fit_function,
)
from spcola.photometry.functions import PhotometricFunction, photometric_function

PHOTOMETRY_FILE = "photometry.json"
PHOTOMETRY_KEYS = {
    "solution": "the SPC solution whose images and maplets were used",
    "calibrated": "whether one scale λ was common to all images, in the numbers of the files that "
    "were imported; else each image has its own",
    "filters": "an entry for each filter; `unknown` where images.jsonl does not state it",
    "filters[].n_images": "images used; their number",
    "filters[].n_samples": "blocks of ground in an image, two pixels wide or more",
    "filters[].n_independent": "independent ones: errors of a place are common to all images",
    "filters[].phase_deg": "least and largest; so incidence_deg and emission_deg",
    "filters[].preferred": "the function of least BIC",
    "filters[].as_good": "functions that the data do not distinguish from it (2 σ of χ²)",
    "filters[].setting": "the preferred function as a setting: [register] photometry",
    "filters[].functions[].parameters": "of each: value, sigma, unit, code and text of a doubt",
    "filters[].functions[].covariance": "of the parameters, in their order",
    "filters[].functions[].scale": "with `calibrated` λ, else null: of images in I/F the normal "
    "albedo of ground whose albedo is 1 in the maplets; so `scale_sigma`",
    "filters[].functions[].residual_std": "robust, over the mean brightness of an image",
    "filters[].functions[].slope_error_deg": "error of the slopes of blocks by which residuals "
    "scatter; sigmas contain a quarter of it as common to all places",
    "filters[].functions[].worse_by": "χ² above that of the preferred one, standard deviations",
}


def fit_photometry(
    workspace: Workspace, options: PhotometryOptions, executor: Executor, progress: Progress
) -> dict[str, Any]:
    """Fit photometric functions, and write ``photometry.json`` of the solution.

    Returns
    -------
    dict
        The content of that file.

    Raises
    ------
    SettingsError
        If a function or parameter is unknown.
    NotObservableError
        If there are too few images or places.
    """
    functions = [_with_fixed(text) for text in options.functions]
    content: dict[str, Any] = {
        "solution": workspace.solution,
        "calibrated": options.calibrated,
        "filters": [],
    }
    for found in sampled_filters(workspace, options, executor, progress):
        with progress.task(f"fit functions ({found.filter})", len(functions)) as task:
            samples = PhotometricSamples.of(found.found, calibrated=options.calibrated)
            fits = []
            for fit in executor.stream(
                partial(fit_function, samples), (own for own, _ in functions)
            ):
                fits.append(fit)
                task.advance()
        content["filters"].append(
            _filter_json(found, samples, fits, [all_ for _, all_ in functions])
        )
    workspace.write_json(PHOTOMETRY_FILE, content)
    return content


def _with_fixed(text: str) -> tuple[PhotometricFunction, PhotometricFunction]:
    """Return a function whose given parameters are fixed, and the function with all of them.

    Raises
    ------
    SettingsError
        If it is unknown, or a parameter of it is.
    """
    if not text.strip():
        raise SettingsError("is empty", "--function")
    whole = photometric_function(text)
    return whole.fixing([one.partition("=")[0] for one in text.split()[1:]]), whole


def _filter_json(
    found: FilterSamples,
    samples: PhotometricSamples,
    fits: list[PhotometricFit],
    whole: list[PhotometricFunction],
) -> dict[str, Any]:
    compared = compare_fits(samples, fits)
    of = {id(fit): one for fit, one in zip(fits, whole, strict=True)}
    entries = [_function_json(one, of[id(one.fit)]) for one in compared.standings]
    return {
        "filter": found.filter,
        "n_images": found.images,
        "n_samples": len(samples),
        "n_independent": compared.independent,
        **ranges(found),
        "preferred": entries[0]["name"],
        "as_good": [one["name"] for one in entries[1:] if one["as_good"]],
        "setting": entries[0]["setting"],
        "functions": entries,
    }


def _function_json(standing: Standing, whole: PhotometricFunction) -> dict[str, Any]:
    fit = standing.fit
    parameters = fit.function.parameters
    values = dict(zip((one.name for one in parameters), fit.function.values, strict=True))
    sigmas = fit.sigma.tolist()
    named = {}
    for one, sigma in zip(parameters, sigmas, strict=True):
        code, text = fit.doubts.get(one.name, (None, None))
        unknown = code is Doubt.UNDETERMINED
        named[one.name] = {
            "value": values[one.name],
            "sigma": None if unknown else sigma,
            "unit": one.unit,
            "code": code,
            "text": text,
        }
    setting = whole.having(values).text
    fixed = {one.name for one in whole.parameters} - set(values)
    name = " ".join([whole.name, *(part for part in setting.split()[1:] if _of(part) in fixed)])
    return {
        "name": name,
        "setting": setting,
        "parameters": named,
        "covariance": fit.covariance.tolist(),
        "scale": None if fit.scale is None else fit.scale[0],
        "scale_sigma": None if fit.scale is None else fit.scale[1],
        "residual_std": fit.spread,
        "slope_error_deg": math.degrees(fit.slope_sigma),
        "chi_square": standing.chi_square,
        "aic": standing.aic,
        "bic": standing.bic,
        "worse_by": standing.worse_by,
        "as_good": standing.as_good,
        "converged": fit.converged,
        "iterations": fit.iterations,
    }


def _of(part: str) -> str:
    """Return the name of a parameter in a setting's text."""
    return part.partition("=")[0]


def photometry_lines(content: Mapping[str, Any]) -> Iterator[str]:
    """Yield the lines that the command prints."""
    for one in content["filters"]:
        low, high = one["phase_deg"]
        yield (
            f"filter {one['filter']}: {one['n_images']} images, {one['n_samples']} blocks of "
            f"ground in them ({one['n_independent']:.0f} independent), phase {low:.0f}° to "
            f"{high:.0f}°"
        )
        for each in one["functions"]:
            mark = "*" if each["name"] == one["preferred"] else "=" if each["as_good"] else " "
            yield (
                f"{mark} {each['name']}: residual {100 * each['residual_std']:.2f} %, "
                f"BIC {each['bic']:.1f}, worse by {each['worse_by']:.1f} σ"
                + ("" if each["converged"] else ", not converged")
            )
            yield from _parameter_lines(each["parameters"])
            if each["scale"] is not None:
                yield f"    λ = {each['scale']:.6g} ± {each['scale_sigma']:.2g}"
        if one["as_good"]:
            others = ", ".join(one["as_good"])
            yield f"The data do not distinguish {one['preferred']} from {others}."
        places = "For [register], and [lithos] if it has its own, in spcola.toml"
        yield f'{places}: photometry = "{one["setting"]}"'


def _parameter_lines(parameters: Mapping[str, Mapping[str, Any]]) -> Iterator[str]:
    for name, one in parameters.items():
        unit = f" {one['unit']}" if one["unit"] else ""
        sigma = "" if one["sigma"] is None else f" ± {one['sigma']:.2g}"
        doubt = "" if one["code"] is None else f" [{one['code']}: {one['text']}]"
        yield f"    {name} = {one['value']:.6g}{sigma}{unit}{doubt}"
