"""Damages files as chance and malice do."""
