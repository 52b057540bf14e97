"""The window. Each file wires one thing: session and engine on one side, widgets on the other."""
