"""Frozen data that describes tasks, rules, sensors, radios, spaces and the origins of datasets."""
