"""The bank: records with hidden effects, given to flex_diagnose as a user would, and scored."""
