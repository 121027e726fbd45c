"""The arm's muscles: tables, paths, how they were fitted, and how they enter a MuJoCo model."""
