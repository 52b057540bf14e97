"""Many runs at once: an index of what they show, and questions that it answers without opening any."""
