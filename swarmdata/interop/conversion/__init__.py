"""What all foreign formats share: episodes cut from timelines, spaces, notes, user choices."""
