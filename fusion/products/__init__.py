"""What is handed on: fused maplets and bigmaps in the formats of the field, with their origin."""
