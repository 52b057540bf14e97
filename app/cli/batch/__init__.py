"""`degense batch`."""
