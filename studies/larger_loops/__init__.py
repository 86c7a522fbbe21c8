"""What becomes of the diamond's threshold in loops of any order: the page of the documentation."""
