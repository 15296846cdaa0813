"""Tables of text with declared columns."""
