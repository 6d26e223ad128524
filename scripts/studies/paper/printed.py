"""Numbers as printed in the source paper."""

MACH = (0, 2, 3, 4)
# Table 2: total pressure [Pa], density [kg/m3]; T0 = 288 K.
TABLE_2 = {2: (0.19e6, 0.51), 3: (0.36e6, 0.33), 4: (0.63e6, 0.20)}
TOTAL_TEMPERATURE = 288.0  # [K]
TABLE_3 = {0: 2.019, 2: 1.878, 3: 1.809, 4: 1.738}  # test peaks [V]
TABLE_4 = {0: 0.0128, 2: 0.0851, 3: 0.1387, 4: 0.1865}  # (test - simulated) / simulated
TABLE_6 = {0: 0.7981, 2: 0.7745, 3: 0.7561, 4: 0.7432}
# Peaks of the paper's simulation, computed from its tables [V]: Table 3 over 1 + Table 4.
SIMULATED = {mach: peak / (1.0 + TABLE_4[mach]) for mach, peak in TABLE_3.items()}
FIGURE_1 = 3.09e-4  # greatest relative error of a ray's height
