"""What is done for each sample, as plain loops over arrays that Numba compiles; a loop calls no other, and keeps nothing."""
