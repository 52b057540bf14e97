"""What scores say, for people: tables, and pages in Markdown and HTML."""

from degense.engine.research.report.method_scores import MethodScores
from degense.engine.research.report.pages import write_report
from degense.engine.research.report.pictures import ReportPicture, pictures_of

__all__ = ["MethodScores", "ReportPicture", "pictures_of", "write_report"]
