"""Dataset cards: their template, the published cards and the measured references."""

if not __name__.startswith("swarmdata."):
    raise ImportError(f"import swarmdata.{__name__}, not {__name__}")
