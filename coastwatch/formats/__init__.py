"""Wire formats: bytes or lines to reports, and back. No socket and no file is opened here."""
