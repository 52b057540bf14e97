"""What `query` and `search` do."""
