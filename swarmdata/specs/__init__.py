"""Specs as frozen data: tasks, rules, sensors, radios, spaces, and what datasets are made from."""
