"""What a study is and becomes: its plan, its life, that of its instances, its goal."""
