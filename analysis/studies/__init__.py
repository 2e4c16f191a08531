"""Studies: each answers one question by many runs. A new one is a module here and an entry of the table in command.py."""
