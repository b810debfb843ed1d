// OpenFOAM's values for a step: swept_faces FILE, in a case whose mesh goes to the points in the file "moved".
// Written are the points before, and of each face its nodes and its swept volume: meshPhi times the time step.
#include "IFstream.H"
#include "OFstream.H"
#include "Time.H"
#include "argList.H"
#include "fvMesh.H"
#include "surfaceFields.H"

using namespace Foam;

int main(int argc, char* argv[])
{
    argList::noParallel();
    argList::addArgument("FILE");
    argList args(argc, argv);
    Time time(Time::controlDictName, args);
    fvMesh mesh(IOobject(fvMesh::defaultRegion, time.timeName(), time, IOobject::MUST_READ));
    const pointField before(mesh.points()), after(IFstream("moved")());
    OFstream out(args[1]);
    out.precision(17);
    time++;
    mesh.movePoints(after);
    const surfaceScalarField& phi = mesh.phi();
    const scalar dt = time.deltaTValue();
    forAll(before, i)
    {
        out << before[i].x() << ' ' << before[i].y() << ' ' << before[i].z() << nl;
    }
    forAll(mesh.faces(), i)
    {
        const label patch = i < mesh.nInternalFaces() ? -1 : mesh.boundaryMesh().whichPatch(i);
        const scalar swept =
            patch < 0 ? phi[i] : phi.boundaryField()[patch][i - mesh.boundaryMesh()[patch].start()];
        forAll(mesh.faces()[i], k)
        {
            out << mesh.faces()[i][k] << ' ';
        }
        out << swept*dt << nl;
    }
    return 0;
}
