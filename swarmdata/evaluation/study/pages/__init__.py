"""The pages of a study: tables, figures and computed sentences."""
