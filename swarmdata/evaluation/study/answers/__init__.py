"""Pages that answer questions from the folders of finished studies."""
