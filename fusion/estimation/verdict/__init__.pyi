from .verdict import JUDGEMENTS as JUDGEMENTS
from .verdict import Cause as Cause
from .verdict import Code as Code
from .verdict import Finding as Finding
from .verdict import Severity as Severity
from .verdict import Verdict as Verdict
from .verdict import verdict_lines as verdict_lines
