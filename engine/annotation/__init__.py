"""Label maps made and corrected by hand, and propagated through time. Only `propagation` and what it stands on need torch."""
