"""Results of evaluations: files, checks, tables, figures and reports."""
