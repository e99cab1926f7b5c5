# y = a x + b at x = 0 … 99, written to NAME_sim.txt:
#     awk -f linear.awk -v a=0.2 -v b=5 -v name=NAME
BEGIN {
    CONVFMT = "%.12g"
    file = name "_sim.txt"
    print "x\ty" > file
    for (x = 0; x < 100; x++) print x "\t" a * x + b > file
}
