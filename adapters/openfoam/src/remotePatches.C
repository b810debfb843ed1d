// SPDX-License-Identifier: GPL-3.0-or-later
#include "remotePatches.H"
#include "releases.H"
#include "cyclicPolyPatch.H"
#include "emptyPolyPatch.H"
#include "processorPolyPatch.H"
#include "symmetryPlanePolyPatch.H"
#include "symmetryPolyPatch.H"
#include "boundBox.H"
#include "syncTools.H"
#include "valuePointPatchField.H"
#include "wedgePolyPatch.H"

namespace
{

const Foam::wordList& roleNames()
{
    static const Foam::wordList names
    ({
        "moving", "fixed", "slip", "symmetry", "periodic", "free", "empty",
        "wedge"
    });
    return names;
}


Foam::wordList physicalNames(const Foam::polyBoundaryMesh& boundary)
{
    Foam::wordList names(boundary.names());
    names.setSize(Foam::nNonProcessor(boundary));
    return names;
}


//- Patches with their own boundary condition. Those of a cellZone's mesh are
//  the same; its faces to other cells, if any, come after them
Foam::label nPhysical(const Foam::pointVectorField& displacement)
{
    return Foam::nNonProcessor(displacement.mesh()().boundaryMesh());
}

} // End anonymous namespace


Foam::word Foam::remotePatches::roleOf
(
    const polyPatch& pp,
    const dictionary& given
)
{
    if (isA<processorPolyPatch>(pp))
    {
        return word();
    }
    word role;
    if (isA<symmetryPolyPatch>(pp) || isA<symmetryPlanePolyPatch>(pp))
    {
        role = "symmetry";
    }
    else if (isA<cyclicPolyPatch>(pp))
    {
        role = "periodic";
    }
    else if (isA<emptyPolyPatch>(pp))
    {
        role = "empty";
    }
    else if (isA<wedgePolyPatch>(pp))
    {
        role = "wedge";
    }
    const word standard(role);
    // on all ranks: a patch may have its faces on another one
    const bool hasFaces = returnReduce(pp.size(), sumOp<label>()) > 0;
    if (!given.readIfPresent(pp.name(), role) && role.empty())
    {
        if (!hasFaces)
        {
            return word();
        }
        FatalIOErrorInFunction(given)
            << "patch " << pp.name() << " has no role" << nl
            << "    give it one of " << flatOutput(roleNames())
            << exit(FatalIOError);
    }
    static const wordList typed({"empty", "wedge", "periodic"});
    if
    (
        !contains(roleNames(), role)
     || ((contains(typed, role) || contains(typed, standard)) && role != standard)
    )
    {
        FatalIOErrorInFunction(given)
            << "patch " << pp.name() << " of type " << pp.type()
            << " cannot have the role " << role << nl
            << "    roles are " << flatOutput(roleNames())
            << ", empty, wedge and periodic for patches of type empty, wedge "
            << "and cyclic"
            << exit(FatalIOError);
    }
    if (role == "periodic" && Pstream::parRun())
    {
        FatalIOErrorInFunction(given)
            << "patch " << pp.name()
            << " is periodic, which remoteMeshMotion offers in serial only"
            << exit(FatalIOError);
    }
    const bool unknown = role == "empty" || role == "wedge" || role == "free";
    return unknown ? word() : role;
}


void Foam::remotePatches::checkNames
(
    const polyBoundaryMesh& boundary,
    const dictionary& given
)
{
    const wordList names(physicalNames(boundary));
    for (const entry& e : given)
    {
        bool found = boundary.findPatchID(e.keyword()) >= 0;
        for (const word& name : names)
        {
            found = found || e.keyword().match(name);
        }
        if (!found)
        {
            FatalIOErrorInFunction(given)
                << "there is no patch " << e.keyword() << nl
                << "    patches are " << flatOutput(names)
                << exit(FatalIOError);
        }
    }
}


Foam::remotePatches::remotePatches
(
    const polyMesh& mesh,
    const dictionary& coeffs
)
:
    roles_(mesh.boundaryMesh().size())
{
    const dictionary& given = coeffs.subDict("patches");
    checkNames(mesh.boundaryMesh(), given);
    forAll(roles_, patchi)
    {
        roles_[patchi] = roleOf(mesh.boundaryMesh()[patchi], given);
    }
    if (!contains(roles_, "moving"))
    {
        FatalIOErrorInFunction(given)
            << "no patch has the role moving" << nl << "    patches are "
            << flatOutput(physicalNames(mesh.boundaryMesh()))
            << exit(FatalIOError);
    }
}


void Foam::remotePatches::check
(
    const pointVectorField& displacement,
    const dictionary& coeffs
) const
{
    const label n = nPhysical(displacement);
    if (n < roles_.size() && roles_[n] == "moving")
    {
        FatalIOErrorInFunction(coeffs)
            << "the faces between the cellZone and other cells have the role "
            << "moving, but no boundary condition says where they go" << nl
            << "    use fixed or free" << exit(FatalIOError);
    }
    for (label patchi = 0; patchi < n; ++patchi)
    {
        const auto& pf = displacement.boundaryField()[patchi];
        if
        (
            roles_[patchi] == "moving"
         && !isA<valuePointPatchField<vector>>(pf)
        )
        {
            FatalIOErrorInFunction(coeffs)
                << "patch " << pf.patch().name() << " has the role moving, "
                << "but its boundary condition " << pf.type() << " of "
                << displacement.name() << " does not say where it goes" << nl
                << "    use fixedValue, or one of those in libfvMotionSolvers"
                << exit(FatalIOError);
        }
    }
}


Foam::vectorField Foam::remotePatches::onPatch
(
    const pointVectorField& displacement,
    const label patchi,
    const pointField& points0
)
{
    const vector none(vector::uniform(-VGREAT));
    vectorField highest(displacement.size(), none);
    const auto& pf = displacement.boundaryField()[patchi];
    const vectorField& value = refCast<const valuePointPatchField<vector>>(pf);
    const labelList& points = pf.patch().meshPoints();
    UIndirectList<vector>(highest, points) = value;
    if (!Pstream::parRun())
    {
        return highest;
    }
    const polyMesh& mesh = displacement.mesh()();
    vectorField lowest(displacement.size(), -none), sum(lowest.size(), Zero);
    scalarField weight(lowest.size(), Zero);
    UIndirectList<vector>(lowest, points) = value;
    for (const face& f : mesh.boundaryMesh()[patchi])
    {
        const point centre(f.centre(points0));
        for (const label pointi : f)
        {
            weight[pointi] += 1.0/mag(centre - points0[pointi]);
        }
    }
    for (const label pointi : points)
    {
        sum[pointi] = weight[pointi]*highest[pointi];
    }
    // a rank may hold a point of a moving patch without a face of it
    syncTools::syncPointList(mesh, highest, maxEqOp<vector>(), none);
    syncTools::syncPointList(mesh, lowest, minEqOp<vector>(), -none);
    syncTools::syncPointList(mesh, sum, plusEqOp<vector>(), vector(Zero));
    syncTools::syncPointList(mesh, weight, plusEqOp<scalar>(), scalar(0));
    forAll(highest, pointi)
    {
        if (weight[pointi] > 0 && highest[pointi] != lowest[pointi])
        {
            highest[pointi] = sum[pointi]/weight[pointi];
        }
    }
    return highest;
}


Foam::tmp<Foam::vectorField> Foam::remotePatches::moved
(
    const pointVectorField& displacement,
    const pointField& points0
) const
{
    const scalar extent = cmptMax(boundBox(points0, true).span());
    // a point of two patches takes the larger of each component, if they
    // differ by no more than rounding: section 9.3 of SPEC.md
    tmp<vectorField> thighest
    (
        new vectorField(displacement.size(), vector::uniform(-VGREAT))
    );
    vectorField& highest = thighest.ref();
    vectorField lowest(displacement.size(), vector::uniform(VGREAT));
    const label n = nPhysical(displacement);
    for (label patchi = 0; patchi < n; ++patchi)
    {
        if (roles_[patchi] == "moving")
        {
            const vectorField value(onPatch(displacement, patchi, points0));
            forAll(value, pointi)
            {
                if (value[pointi] != vector::uniform(-VGREAT))
                {
                    highest[pointi] = max(highest[pointi], value[pointi]);
                    lowest[pointi] = min(lowest[pointi], value[pointi]);
                }
            }
        }
    }
    boolList held(displacement.size(), true);
    forAll(highest, pointi)
    {
        if (highest[pointi].x() < lowest[pointi].x())
        {
            highest[pointi] = Zero;
            continue;
        }
        held[pointi] = false;
        if (cmptMax(highest[pointi] - lowest[pointi]) > 1e-7*extent)
        {
            FatalErrorInFunction
                << "point " << pointi << " lies on moving patches that move it "
                << "to different places, by " << lowest[pointi] << " and "
                << highest[pointi] << " (lowest and highest components)" << nl
                << "    give both patches the same displacement there"
                << exit(FatalError);
        }
    }
    checkFixed(displacement, held);
    return thighest;
}


void Foam::remotePatches::checkFixed
(
    const pointVectorField& displacement,
    const boolList& held
) const
{
    const label n = nPhysical(displacement);
    for (label patchi = 0; patchi < n; ++patchi)
    {
        const auto& pf = displacement.boundaryField()[patchi];
        if (roles_[patchi] == "fixed" && isA<valuePointPatchField<vector>>(pf))
        {
            const vectorField& value =
                refCast<const valuePointPatchField<vector>>(pf);
            const labelList& points = pf.patch().meshPoints();
            scalar most = 0;
            forAll(value, i)
            {
                if (held[points[i]])
                {
                    most = max(most, mag(value[i]));
                }
            }
            if (most > 0)
            {
                FatalErrorInFunction
                    << "patch " << pf.patch().name() << " has the role fixed, "
                    << "but " << displacement.name() << " moves it by " << most
                    << nl << "    give it the role moving in dynamicMeshDict"
                    << exit(FatalError);
            }
        }
    }
}
