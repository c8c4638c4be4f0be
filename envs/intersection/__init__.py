"""The task `intersection`: robots cross from arm to arm, without a right of way."""
