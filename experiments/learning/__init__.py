"""What `trackslip train` trains: the environments, the policies, and what is shown of them afterwards."""
