"""What engines are given to do: tables and sums that are worked out from a field, rays and a pupil."""
