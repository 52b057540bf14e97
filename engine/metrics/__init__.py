"""Image, mask and motion scores, each with its protocol in its docstring; `evaluate.evaluate` applies them to a run."""
