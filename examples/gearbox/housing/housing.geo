// Housing of an 850 kW gearbox: ring gear, torque arm on two supports, high-speed
// housing with the seats of six bearings. Metres; z along the main shaft, from the
// rotor to the generator, y up, origin on the axis in the mid-plane of the ring gear.
SetFactory("OpenCASCADE");

r_pitch = 0.49872;  // ring gear, 90 teeth of module 11 mm at 7 degrees
r_outer = 0.600;
half    = 0.140;    // half the face width
arm     = 0.140;    // thickness of the torque arm's plate
edges   = 120;      // of elements on the pitch circle, with a unit load at each end and middle

// Torque arm: a plate in front of the ring gear, with an arm to each side.
Cylinder(1) = {0, 0, -half - arm, 0, 0, arm, r_outer};
Box(2) = {-1.15, -0.15, -half - arm, 2.3, 0.30, arm};
BooleanUnion(3) = { Volume{1}; Delete; }{ Volume{2}; Delete; };
Cylinder(4) = {0, 0, -half - arm, 0, 0, arm, 0.40};
BooleanDifference(5) = { Volume{3}; Delete; }{ Volume{4}; Delete; };

// Ring gear, in two halves: the contacts lie on the edge between them.
Cylinder(10) = {0, 0, -half, 0, 0, half, r_outer};
Cylinder(11) = {0, 0, -half, 0, 0, half, r_pitch};
BooleanDifference(12) = { Volume{10}; Delete; }{ Volume{11}; Delete; };
Cylinder(13) = {0, 0, 0, 0, 0, half, r_outer};
Cylinder(14) = {0, 0, 0, 0, 0, half, r_pitch};
BooleanDifference(15) = { Volume{13}; Delete; }{ Volume{14}; Delete; };

// High-speed housing: a box between two walls that carry the bearings, and a
// neck that joins it to the ring gear.
z1 = 0.32; z2 = 0.38;   // front wall
z3 = 0.72; z4 = 0.78;   // rear wall
Cylinder(20) = {0, 0, half, 0, 0, z1 - half, r_outer};
Cylinder(21) = {0, 0, half, 0, 0, z1 - half, 0.52};
BooleanDifference(22) = { Volume{20}; Delete; }{ Volume{21}; Delete; };
Box(23) = {-0.62, -0.62, z1, 1.50, 1.24, z4 - z1};
Box(24) = {-0.58, -0.58, z2, 1.42, 1.16, z3 - z2};
BooleanDifference(25) = { Volume{23}; Delete; }{ Volume{24}; Delete; };

// Axes of the sun's, the middle and the fast shaft, as the teeth give them.
x1 = 0.53208 * Cos(20 * Pi / 180); y1 = 0.53208 * Sin(20 * Pi / 180);
x2 = x1 + 0.29137 * Cos(-80 * Pi / 180); y2 = y1 + 0.29137 * Sin(-80 * Pi / 180);
// Bearings: discs in the walls, much softer than these; their middle takes the force.
r0 = 0.16; r1 = 0.12; r2 = 0.09;
bx() = {0, x1, x2}; by() = {0, y1, y2}; br() = {r0, r1, r2};
For i In {0:2}
  For wall In {0:1}
    z = (wall == 0) ? z1 : z3;
    k = 30 + 4 * i + 2 * wall;
    Cylinder(k) = {bx(i), by(i), z, 0, 0, z2 - z1, br(i), Pi};
    Cylinder(k + 1) = {bx(i), by(i), z, 0, 0, z2 - z1, br(i), Pi};
    Rotate{{0, 0, 1}, {bx(i), by(i), 0}, Pi}{ Volume{k + 1}; }
  EndFor
EndFor
Coherence;

// Mesh: quadratic tetrahedra. Their edges on the pitch circle are short against the
// distance to the gauges and the arc of a contact, so that it matters little
// whether a contact stands on a node or between two.
e = 1e-4;
contact() = Curve In BoundingBox{-r_pitch - e, -r_pitch - e, -e, r_pitch + e, r_pitch + e, e};
Transfinite Curve{contact()} = edges + 1;
Mesh.CharacteristicLengthMax = 0.17;
ring() = Point In BoundingBox{-r_outer - e, -r_outer - e, -half - e, r_outer + e, r_outer + e, half + e};
Characteristic Length{ring()} = 0.09;
seats() = Point In BoundingBox{-1, -1, z1 - e, 1, 1, z4 + e};
Characteristic Length{seats()} = 0.14;
Mesh.ElementOrder = 2;
Mesh.SecondOrderLinear = 0;
Mesh.Algorithm3D = 1;
Mesh.RandomSeed = 1;

bearing() = {30:41};
all() = Volume "*";
all() -= bearing();
Physical Volume("housing") = all();
Physical Volume("bearings") = bearing();
Physical Curve("contact") = contact();
// The inner faces of the walls: there the bearings' forces act.
For i In {0:2}
  For wall In {0:1}
    z = (wall == 0) ? z2 : z3;
    p() = Point In BoundingBox{bx(i) - e, by(i) - e, z - e, bx(i) + e, by(i) + e, z + e};
    Physical Point(Sprintf("bearing%g", 2 * i + wall)) = p();
  EndFor
EndFor
// The supports: the ends of the arms.
left() = Surface In BoundingBox{-1.15 - e, -1, -1, -1.15 + e, 1, 1};
right() = Surface In BoundingBox{1.15 - e, -1, -1, 1.15 + e, 1, 1};
Physical Surface("left") = left();
Physical Surface("right") = right();
Mesh.SaveGroupsOfNodes = 1;
