"""How kernels become machine code: what they are filed under, where they are kept, how one is made from another."""
