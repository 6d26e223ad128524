"""How many leapfrog samples a bundle needs: what they cost, and what they could miss in between."""
