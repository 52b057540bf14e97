"""Any number of clips and settings: train, score, ask and export each, several at a time, and go on where it stopped."""
