"""Parts that the converters share: timelines cut into episodes, spaces, notes, user choices."""
