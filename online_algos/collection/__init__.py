"""How online algorithms collect data: worlds, replay, input normalization."""
