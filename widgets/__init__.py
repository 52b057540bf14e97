"""Qt widgets that know arrays and signals only."""

from degense.widgets.unread_sources import leave_sources_unread

leave_sources_unread()
