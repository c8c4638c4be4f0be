"""The sections of a card."""
