"""Commands that make datasets: generated, edited, converted, recorded."""
