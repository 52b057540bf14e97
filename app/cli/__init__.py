"""One module for each kind of command. A command takes the parsed options and returns the exit status, None for 0."""
