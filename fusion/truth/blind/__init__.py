"""Blind missions: what a mission delivers before anyone has made a solution."""
