"""The parts of isotherm-eoffset: the registers and their rules, the pins of HAL, Modbus."""
