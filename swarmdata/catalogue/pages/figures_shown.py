"""Figures as the pages write them; unknown ones are dashes."""

UNKNOWN = "–"


def count(number: int, thing: str) -> str:
    """A number with its noun, such as `1 dataset` or `2 datasets`."""
    return f"{number:,} {thing}{'' if number == 1 else 's'}"


def compact(number: int) -> str:
    """A large number in three digits, such as `50.1 k` or `1.00 M`."""
    for unit, size in (("M", 1_000_000), ("k", 1_000)):
        if number >= size:
            value = number / size
            return f"{value:.{max(0, 3 - len(str(int(value))))}f} {unit}"
    return str(number)


def percent(share: float | None) -> str:
    """A share of episodes."""
    return UNKNOWN if share is None else f"{100 * share:.0f} %"


def score(value: float | None) -> str:
    """A normalized score: 0 no skill, 100 the expert."""
    return UNKNOWN if value is None else str(round(value))


def file_size(n_bytes: int | None) -> str:
    """A size on disk."""
    if n_bytes is None:
        return UNKNOWN
    for unit, size, decimals in (("GB", 1e9, 1), ("MB", 1e6, 0)):
        if n_bytes >= size:
            return f"{n_bytes / size:.{decimals}f} {unit}"
    return f"{n_bytes / 1e3:.0f} kB"


def per_episode(collisions: tuple[float, float] | None) -> str:
    """The mean number of collisions of an episode, of both kinds."""
    return UNKNOWN if collisions is None else f"{sum(collisions):.2f}"
