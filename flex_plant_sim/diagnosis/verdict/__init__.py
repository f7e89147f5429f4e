"""From a posterior to a verdict, and what the record could have shown."""
