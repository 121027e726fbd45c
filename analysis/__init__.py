"""What is made of numbers: designs, indices and their service, reports and files.

`given` is about samples of one's own, `closeloop` about recordings that the model does not explain,
`interpretation` about the stiffness of one recorded patient.
"""
