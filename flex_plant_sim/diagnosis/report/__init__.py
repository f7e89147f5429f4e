"""The outputs of a diagnosis: the answer, the HTML report and the extended robot file."""
