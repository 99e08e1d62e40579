"""What a fit leaves: whether it is more than noise, how it depends on conditions and time, and which runs are bad."""
