"""The assessment: models of the synthetic body against its truth, every figure defined."""
