"""The pages of a study: tables and figures, below text that authors write."""
