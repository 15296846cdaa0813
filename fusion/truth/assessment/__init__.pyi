from .assessment import assess as assess
from .gather import file_model as file_model
from .gather import workspace_models as workspace_models
from .page import write_page as write_page
from .settings import AssessmentSettings as AssessmentSettings
from .summary import assessment_json as assessment_json
from .summary import assessment_lines as assessment_lines
