"""Settings that every test shares."""

from hypothesis import settings

settings.register_profile("quick", deadline=None, max_examples=15)
settings.load_profile("quick")
