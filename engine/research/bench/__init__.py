"""Programs that measure and print tables; none of them is a test."""
