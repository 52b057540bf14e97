"""What a user does, by hand: twenty tasks by the keyboard alone and by the mouse alone."""
