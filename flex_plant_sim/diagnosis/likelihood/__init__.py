"""What a record says of parameters and causes: prior and evidence."""
