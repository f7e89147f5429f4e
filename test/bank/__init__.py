"""The bank: records with hidden effects, handed to flex_diagnose as a user would, and scored."""
