"""The style of figures, and Markdown."""
