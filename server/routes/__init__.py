"""HTTP in and out, one file per noun. No decisions here."""
