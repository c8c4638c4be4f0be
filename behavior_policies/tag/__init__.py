"""Scripted sides of the task `tag`: pursuers as in `pursuit`, and an evader that looks ahead."""
