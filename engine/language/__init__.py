"""From words to vectors and from label maps to training targets."""
