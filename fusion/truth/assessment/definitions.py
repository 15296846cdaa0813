"""Definitions of all numbers of the assessment, for its JSON and its page."""

from __future__ import annotations

from dataclasses import asdict

from fusion.truth.assessment.settings import AssessmentSettings

# Names in braces are settings, or computed from them below.
_DEFINITIONS = {
    "rms_3d_m": "3D rms: root mean square, over the vertices, of the distance from a vertex "
    "of the model to the closest point of the truth surface; the coordinates of the model are "
    "taken as the body's (Weirich et al., section 2.8). Metres. "
    "A whole body moved by d gives about d/√3, since motion along the surface has no effect.",
    "rms_3d_without_offset_m": "The same after the translation of the model that minimises it: "
    "without the offset of the centre of figure.",
    "rms_3d_optimised_m": "Optimised 3D rms: the same after the translation and rotation that "
    "minimise it (point-to-plane ICP; never a scale).",
    "mean_distance_m": "Mean of the signed distances of the 3D rms, positive where the model "
    "lies outside the truth.",
    "largest_distance_m": "Largest absolute distance of the 3D rms.",
    "center_offset_m": "The translation of rms_3d_without_offset_m with its sign reversed: the "
    "offset of the model along the body's x, y, z. Its sigma is from the scatter of 216 cells "
    "of the body.",
    "center_of_figure_offset_m": "Centroid of the model's volume minus that of the truth's; "
    "closed meshes only.",
    "optimised_translation_m": "Translation of rms_3d_optimised_m: the motion of the vertices' "
    "mean, along the body's x, y, z.",
    "optimised_rotation_deg": "Rotation vector of rms_3d_optimised_m about the vertices' mean.",
    "vertices": "Vertices of the 3D rms: {vertices} at most, chosen at random (all "
    "points of a mesh; the points of the maplets compared).",
    "patches_compared": "Maplets whose heights are compared, {patches} at most, "
    "evenly taken from patches_there; a mesh is sampled by rays on squares at the step of its "
    "vertices; maps of more than {patch_size} points across are cut.",
    "height_error": "Model minus truth along Uz at a point of the model's grid. Models in SPC "
    "coordinates are compared in the planted frame: the truth is moved to SPC coordinates by "
    "the planted similarity, so that planted scale, rotation and translation are not errors.",
    "mean_m": "Mean of the height errors. All points of overlapping maplets count.",
    "rms_m": "Root mean square of the height errors.",
    "robust_std_m": "1.4826 × median absolute deviation of height errors from their median.",
    "largest_m": "Largest absolute height error.",
    "slope_rms_deg": "Root mean square of the angle between the normals of model and truth, "
    "both from central differences over two grid steps.",
    "sigma_rms_m": "Root mean square of the stated sigmas: the sigma of the height and, where "
    "the model states one, the sigma of its centre along the surface normal "
    "(Uz − ∂h/∂x Ux − ∂h/∂y Uy).",
    "pull_mean": "Mean of height error / stated sigma; 0 without a bias.",
    "pull_std": "Standard deviation of height error / stated sigma; 1 if sigmas are correct.",
    "within_1_sigma": "Share of the height errors within one stated sigma; 0.683 if sigmas are "
    "correct and errors normal.",
    "within_2_sigma": "Share within two stated sigmas; 0.954 if sigmas are correct.",
    "resolution_m": "Wavelength below which the model contains less than half of the truth's "
    "power: transfer² < ½, with transfer = Re Σ S_mt / Σ S_tt, the cross-spectrum of model "
    "and truth over the truth's spectrum, summed over rings of wavenumber and over windows "
    "without their plane, tapered by a Hann window. Blur by a Gaussian of standard deviation s "
    "gives 2π s / √ln 2 = 7.55 s.",
    "coherent_resolution_m": "Wavelength below which the coherence |Σ S_mt|² / (Σ S_mm Σ S_tt) "
    "is less than ½: the model contains more noise than truth.",
    "formu_m": "FormU: root mean square, over the maplets of the highest resolution, of their "
    "residuals; a residual is the root mean square, over the images that measured the "
    "maplet's centre, of predicted minus measured position (pixel and line together) times the "
    "size of a pixel on the surface (pixel angle × distance).",
    "formu_share_80_m": "80 % of those maplets have a residual below this.",
    "formu_ratio": "FormU of the SPC solution divided by the optimised 3D rms of the model.",
    "lit": "Surface that is lit (incidence below 80°, no cast shadow) for {dark_percent:g} % of a "
    "rotation or more.",
    "shadowed": "Surface that is lit for less than {dark_percent:g} % of a rotation.",
    "boulders": "Inside the outlines of boulders of {smallest:g} m or more.",
    "craters": "Inside the rims of craters of {crater:g} m or more, not on boulders.",
    "smooth site": "Inside the smooth site, if the body has one.",
    "other ground": "Outside those boulders and craters, and outside the smooth site.",
    "latitude": "Planetocentric latitude.",
    "pull": "(recovered − planted) / stated sigma of the recovered value.",
}


def definitions(settings: AssessmentSettings) -> dict[str, str]:
    """Return key → definition, with the numbers of `settings`."""
    numbers = {
        **asdict(settings),
        "patch_size": 2 * settings.patch_half_size + 1,
        "dark_percent": 100.0 * settings.dark_share,
        "crater": 2 * settings.smallest,
    }
    return {key: text.format(**numbers) for key, text in _DEFINITIONS.items()}
