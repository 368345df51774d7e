"""What the studies share: sequences, records, pages, stand-ins."""
