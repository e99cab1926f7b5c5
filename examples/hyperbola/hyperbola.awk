# y = x / (a + b x) and its slope a / (a + b x)² at x = 0, 0.1 … 5, written to NAME_sim.txt:
#     awk -f hyperbola.awk -v a=0.2 -v b=0.5 -v name=NAME
BEGIN {
    CONVFMT = "%.12g"
    file = name "_sim.txt"
    print "x\ty\tslope" > file
    for (i = 0; i <= 50; i++) {
        x = i / 10
        print x "\t" x / (a + b * x) "\t" a / (a + b * x) ^ 2 > file
    }
}
