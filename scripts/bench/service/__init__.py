"""Benches of the service: a real server process under load, faults and damaged files."""
