# One line of JSON in, one out: {"parameters": {"x1": 0.3, "x2": 1, "x3": 2}, "seed": 7}
{
    for (i = 1; i <= 3; i++) {
        match($0, "\"x" i "\": *[-+.0-9eE]+")
        found = substr($0, RSTART, RLENGTH)
        sub(/^[^:]*: */, "", found)
        x[i] = found + 0
    }
    y = sin(x[1]) + 7 * sin(x[2])^2 + 0.1 * x[3]^4 * sin(x[1])
    printf "{\"outputs\": {\"y\": %.17g}}\n", y
    fflush()
}
