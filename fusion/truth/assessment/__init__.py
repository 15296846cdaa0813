"""Models compared with the truth."""

from fusion.truth.assessment.assessment import assess
from fusion.truth.assessment.gather import file_model, workspace_models
from fusion.truth.assessment.model import Model
from fusion.truth.assessment.page import write_page
from fusion.truth.assessment.settings import AssessmentSettings
from fusion.truth.assessment.summary import assessment_json, assessment_lines
from fusion.truth.planted import Planted

__all__ = [
    "AssessmentSettings",
    "Model",
    "Planted",
    "assess",
    "assessment_json",
    "assessment_lines",
    "file_model",
    "workspace_models",
    "write_page",
]
