"""What everything else stands on: how kernels compile, declared parameters, random numbers, errors, files."""
