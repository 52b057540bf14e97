"""What scores say, for people: tables, and pages in Markdown and HTML."""

from engine.report.entry import Entry
from engine.report.pages import write_report
from engine.report.pictures import Picture, pictures_of

__all__ = ["Entry", "Picture", "pictures_of", "write_report"]
