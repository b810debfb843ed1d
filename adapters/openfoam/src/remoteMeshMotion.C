// SPDX-License-Identifier: GPL-3.0-or-later
#include "remoteMeshMotion.H"
#include "IFstream.H"
#include "OFstream.H"
#include "OSspecific.H"
#include "SHA1Digest.H"
#include "Time.H"
#include "addToRunTimeSelectionTable.H"
#include "boundBox.H"
#include "knownEntries.H"

namespace Foam
{
    defineTypeNameAndDebug(remoteMeshMotion, 0);

    addToRunTimeSelectionTable
    (
        motionSolver,
        remoteMeshMotion,
        dictionary
    );
}


namespace
{

using namespace Foam;

//- The coefficients, all of which are known
const dictionary& checked(const dictionary& dict, const dictionary& coeffs)
{
    static const wordList known
    ({
        "endpoint", "patches", "method", "onServerLoss", "timeout",
        "computeTimeout", "commit", "atEnd", "durability", "label",
        "secretKey", "serverKey", "evaluation"
    });
    // without a dictionary of their own they stand among those of the mesh
    static const wordList ofMesh
    ({
        "dynamicFvMesh", "dynamicFvMeshLibs", "libs", "motionSolverLibs",
        "motionSolver", "solver", "cellZone", "updateControl",
        "updateInterval"
    });
    const word own(remoteMeshMotion::typeName + "Coeffs");
    checkEntries(coeffs, known, dict.found(own) ? wordList() : ofMesh);
    for (const word& key : known)
    {
        if (dict.found(own) && dict.found(key))
        {
            FatalIOErrorInFunction(dict)
                << "the entry " << key << " stands beside " << own
                << ", where nobody reads it: move it there"
                << exit(FatalIOError);
        }
    }
    return coeffs;
}


//- One of two words, the first where nothing is given
bool isSecond(const dictionary& coeffs, const word& key, const wordList& words)
{
    const word given(coeffs.lookupOrDefault<word>(key, words[0]));
    if (!words.found(given))
    {
        FatalIOErrorInFunction(coeffs)
            << key << " is " << words[0] << " or " << words[1] << "; got "
            << given << exit(FatalIOError);
    }
    return given == words[1];
}

//- The zone that the dictionary names; "" where it names none
word zoneName(const dictionary& dict)
{
    if (dict.found("cellSet"))
    {
        FatalIOErrorInFunction(dict)
            << "remoteMeshMotion moves a cellZone, not a cellSet" << nl
            << "    make one of it, by topoSet's setToCellZone"
            << exit(FatalIOError);
    }
    const word name(dict.lookupOrDefault<word>("cellZone", "none"));
    return name == "none" ? word() : name;
}


//- A dictionary with a name of its own, by which the motion solver of a zone
//  is registered and written; null where it moves the mesh as a whole
std::unique_ptr<IOdictionary> ofZone
(
    const polyMesh& mesh,
    const IOdictionary& dict
)
{
    const word zone(zoneName(dict));
    if (zone.empty())
    {
        return nullptr;
    }
    const IOobject io
    (
        remoteMeshMotion::typeName + '.' + zone,
        mesh.time().constant(),
        mesh,
        IOobject::NO_READ,
        IOobject::AUTO_WRITE
    );
    return std::unique_ptr<IOdictionary>(new IOdictionary(io, dict));
}


//- The cells of a zone as a mesh; null where there is no zone
std::unique_ptr<fvMeshSubset> cellsOf(const polyMesh& mesh, const word& name)
{
    if (name.empty())
    {
        return nullptr;
    }
    std::unique_ptr<fvMeshSubset> subset
    (
        new fvMeshSubset
        (
            refCast<const fvMesh>(mesh),
            mesh.cellZones()[name] // the base class has found it
        )
    );
    // its faces to other cells are of a patch of type empty: a plane's
    fvMesh& own = subset->subMesh();
    const polyBoundaryMesh& boundary = own.boundaryMesh();
    List<polyPatch*> patches(boundary.size());
    forAll(boundary, patchi)
    {
        const polyPatch& pp = boundary[patchi];
        patches[patchi] =
            pp.name() == fvMeshSubset::exposedPatchName
          ? new polyPatch
            (
                pp.name(), pp.size(), pp.start(), patchi, boundary,
                polyPatch::typeName
            )
          : pp.clone(boundary, patchi, pp.size(), pp.start()).ptr();
    }
    own.removeFvBoundary();
    own.addFvPatches(patches);
    return subset;
}

} // End anonymous namespace


const Foam::polyMesh& Foam::remoteMeshMotion::own() const
{
    return zone_ ? zone_->subMesh() : mesh();
}


Foam::tmp<Foam::pointField> Foam::remoteMeshMotion::ofOwn
(
    const pointField& all
) const
{
    return
        zone_
      ? tmp<pointField>(new pointField(all, zone_->pointMap()))
      : tmp<pointField>(all);
}


void Foam::remoteMeshMotion::toAll(const pointField& own, pointField& all) const
{
    if (zone_)
    {
        UIndirectList<point>(all, zone_->pointMap()) = own;
    }
    else
    {
        all = own;
    }
}


Foam::fileName Foam::remoteMeshMotion::folder(const word& instance) const
{
    const fileName uniform(mesh().time().path()/instance/"uniform");
    return uniform/(zone_ ? name() : typeName);
}


Foam::string Foam::remoteMeshMotion::digest() const
{
    dictionary sent;
    sent.add("patches", coeffDict().subDict("patches"));
    sent.add("method", coeffDict().subOrEmptyDict("method"));
    if (zone_)
    {
        sent.add("cellZone", zoneName(*this));
    }
    if (evaluates_)
    {
        sent.add("evaluation", word("client"));
    }
    return sent.digest().str();
}


void Foam::remoteMeshMotion::open()
{
    offset_ = ofOwn(mesh().points()) - ofOwn(points0());
    if (evaluates_)
    {
        offset_ = Zero;
    }
    string label(mesh().time().globalCaseName());
    if (coeffDict().found("label"))
    {
        // with quotes or without
        const token given(coeffDict().lookup("label"));
        label = given.isWord() ? given.wordToken() : given.stringToken();
    }
    session_->open(remoteMesh_, label);
    Info<< "remoteMeshMotion: a new session" << endl;
}


bool Foam::remoteMeshMotion::isWhereItWas()
{
    scalarField rows;
    session_->committed(rows);
    const pointField here(ofOwn(mesh().points()));
    pointField now(here);
    remoteMesh_.toPoints(rows, now);
    // a time that was written with few digits is still the same time
    const scalar allowed = 1e-5*mesh().bounds().mag();
    const scalar most = gMax(mag(now - here)());
    return most <= allowed;
}


bool Foam::remoteMeshMotion::resume()
{
    const fileName path(folder(mesh().time().timeName()));
    bool found = isFile(path/"state");
    Pstream::scatter(found);
    if (!found)
    {
        return false;
    }
    label step = 0, ranks = 0;
    string settings;
    if (Pstream::master())
    {
        const dictionary saved(IFstream(path/"state")());
        step = saved.get<label>("step");
        ranks = saved.get<label>("processors");
        settings = saved.get<string>("settings");
    }
    Pstream::scatter(step);
    Pstream::scatter(ranks);
    Pstream::scatter(settings);
    bool same = ranks == Pstream::nProcs() && settings == digest();
    reduce(same, andOp<bool>()); // each rank may read a dictionary of its own
    if
    (
        !same
     || !session_->resume(path/"credentials", step, remoteMesh_)
     || !isWhereItWas()
    )
    {
        WarningInFunction
            << "the session of " << path << " cannot be resumed: "
            << (
                   same
                 ? "it has gone on since, or it or its credentials are deleted"
                 : "its settings, patches or processors were others"
               )
            << nl << "    A new one begins with the mesh of this time, "
            << "against which sizes of cells are judged from now on" << endl;
        session_.reset(new remoteSession(coeffDict()));
        return false;
    }
    scalarField rows;
    session_->reference(rows);
    const pointField first(ofOwn(points0()));
    pointField reference(first);
    remoteMesh_.toPoints(rows, reference);
    offset_ = reference - first;
    Info<< "remoteMeshMotion: the session goes on behind step " << step << endl;
    return true;
}


Foam::label Foam::remoteMeshMotion::stepsLeft() const
{
    const Time& time = mesh().time();
    const scalar left = (time.endTime() - time).value()/time.deltaTValue();
    if (commitEveryMove_ || !(left > -0.5 && left < labelMax/2))
    {
        return -1;
    }
    return time.timeIndex() - trial_ + label(left + 0.5);
}


void Foam::remoteMeshMotion::commit() const
{
    if (trial_ >= 0)
    {
        session_->commit(stepsLeft());
        trial_ = -1;
    }
}


Foam::remoteMeshMotion::remoteMeshMotion
(
    const polyMesh& mesh,
    const IOdictionary& dict
)
:
    remoteMeshMotion(mesh, dict, ofZone(mesh, dict))
{}


Foam::remoteMeshMotion::remoteMeshMotion
(
    const polyMesh& mesh,
    const IOdictionary& dict,
    const std::unique_ptr<IOdictionary>& ofZone
)
:
    displacementMotionSolver(mesh, ofZone ? *ofZone : dict, typeName),
    zone_(cellsOf(mesh, zoneName(dict))),
    patches_(own(), checked(dict, coeffDict())),
    evaluates_(isSecond(coeffDict(), "evaluation", {"server", "client"})),
    remoteMesh_
    (
        own(), ofOwn(evaluates_ ? points0() : mesh.points()), patches_
    ),
    session_(),
    trial_(-1),
    commitEveryMove_(false)
{
    commitEveryMove_ =
        isSecond(coeffDict(), "commit", {"timeStep", "everyMove"});
    isSecond(coeffDict(), "atEnd", {"keep", "discard"});
    patches_.check(pointDisplacement_, coeffDict());
    session_.reset(new remoteSession(coeffDict()));
    if (!resume())
    {
        open();
    }
}


Foam::tmp<Foam::pointField> Foam::remoteMeshMotion::curPoints() const
{
    return points0() + pointDisplacement_.primitiveField();
}


void Foam::remoteMeshMotion::solve()
{
    const label now = mesh().time().timeIndex();
    if (trial_ >= 0 && trial_ != now)
    {
        commit();
    }
    pointDisplacement_.correctBoundaryConditions();
    patches_.checkFixed(pointDisplacement_);

    const scalar extent = cmptMax(boundBox(points0(), true).span());
    label nMoving = 0;
    const int64_t* moving = session_->movingNodes(nMoving);
    scalarField rows, answer;
    const vectorField moved
    (
        ofOwn(patches_.moved(pointDisplacement_, extent)()) - offset_
    );
    remoteMesh_.toNodes(moved, nMoving, moving, rows);
    session_->move(rows, answer);
    session_->report();

    pointField displacement(own().nPoints(), Zero);
    remoteMesh_.toPoints(answer, displacement);
    displacement += offset_;
    toAll(displacement, pointDisplacement_.primitiveFieldRef());
    trial_ = now;
    if (commitEveryMove_)
    {
        commit();
    }
}


void Foam::remoteMeshMotion::updateMesh(const mapPolyMesh&)
{
    FatalErrorInFunction
        << "the topology of the mesh has changed, which remoteMeshMotion "
        << "cannot follow: restart from a written time" << exit(FatalError);
}


bool Foam::remoteMeshMotion::writeObject
(
    #if OPENFOAM >= 2012
    IOstreamOption,
    #else
    IOstream::streamFormat,
    IOstream::versionNumber,
    IOstream::compressionType,
    #endif
    const bool
) const
{
    commit();
    const fileName path(folder(mesh().time().timeName()));
    if (Pstream::master())
    {
        mkDir(path);
    }
    // before the state, which is what a restart looks for
    session_->save(path/"credentials");
    if (Pstream::master())
    {
        OFstream state(path/"state");
        state.writeEntry("step", session_->step());
        state.writeEntry("processors", Pstream::nProcs());
        state.writeEntry("settings", digest());
    }
    return true;
}
