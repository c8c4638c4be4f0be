"""The kinds of remotes: folders, web hosts, object stores, Hugging Face."""
