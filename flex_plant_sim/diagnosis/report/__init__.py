"""What is printed, drawn and written: answer, report, extended robot file."""
