"""Prior, tempered likelihood and evidence of records, by Laplace's method."""
