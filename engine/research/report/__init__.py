"""What scores say, for people: tables, and pages in Markdown and HTML."""

from degense.engine.research.report.entry import Entry
from degense.engine.research.report.pages import write_report
from degense.engine.research.report.pictures import Picture, pictures_of

__all__ = ["Entry", "Picture", "pictures_of", "write_report"]
